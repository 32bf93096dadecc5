"""How many threads the linear algebra below numpy may have; imports nothing that would load it."""

import os


def one_blas_thread() -> None:
    """Before numpy is loaded: on many small matrices its threads mostly wait for each other, at full speed.

    A survey's poses took ten times as long with two; what `rectify_node` watches, 1.4 times the processor time.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
