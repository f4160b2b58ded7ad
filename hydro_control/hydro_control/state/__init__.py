"""The state of the machine at a sample: what is measured, corrected, filtered and predicted."""
