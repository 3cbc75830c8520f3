"""What a robot runs: the coupled system, among obstacles; one compiled step for roll-outs and control loops alike."""
