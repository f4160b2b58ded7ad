"""What robot descriptions are read and checked with, and what is drawn of them."""
