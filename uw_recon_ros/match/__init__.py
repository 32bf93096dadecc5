"""Matching (paper section 2.3): disparity by graph cuts."""
