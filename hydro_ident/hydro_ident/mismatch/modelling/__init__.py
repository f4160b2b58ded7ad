"""Model: findings as a robot, refined by roll-outs."""
