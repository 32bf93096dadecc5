"""The graph-cut matcher: a semi-global start, then local planes as labels, moved by minimum cuts.

A folder of its own, so that its compiled kernels are cached apart from those of the reference matcher.
"""
