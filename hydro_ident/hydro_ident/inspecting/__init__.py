"""What is in a bag and what is wrong with it."""
