"""For people who look: what a file holds (`clpv info`), and what happened in roll-outs (`clpv inspect`)."""
