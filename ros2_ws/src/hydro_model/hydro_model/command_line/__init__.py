"""What every command line of the packages shares."""
