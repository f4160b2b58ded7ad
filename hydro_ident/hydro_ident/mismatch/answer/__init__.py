"""The diagnosis from end to end: searched, confirmed, described and written."""
