"""Obstacle avoidance, paper eqs. (19)-(23), a version of it that can be proved, and their rivals: one file a method."""
