"""What is watched while the law answers: motion, following, applied voltages, stamps."""
