"""Contiguous pieces of recordings: joined, looked over, filtered and differentiated."""
