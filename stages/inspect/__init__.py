"""What a recording holds, for people: `clpv info`."""
