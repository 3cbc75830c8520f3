"""From the arms' recordings to the motion of one point: paper eq. (4)."""
