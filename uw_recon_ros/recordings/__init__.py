"""Recordings of a rig in whatever form they come: bags, stills, videos; pairs are listed, then read one by one."""
