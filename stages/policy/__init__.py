"""What a robot runs: the coupled system and, later, avoidance and compliance."""
