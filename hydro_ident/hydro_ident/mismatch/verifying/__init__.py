"""Verify: what recordings that took no part say of a finding."""
