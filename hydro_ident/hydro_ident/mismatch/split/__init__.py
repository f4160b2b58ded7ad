"""Which rows take part: those that are searched, fitted and checked on."""
