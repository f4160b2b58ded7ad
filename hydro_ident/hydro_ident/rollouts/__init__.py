"""Roll-outs of a robot against what was recorded."""
