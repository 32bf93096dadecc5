"""Preprocessing (paper section 2.1): nine steps from a raw pair to an enhanced one."""
