"""The variables by which linear algebra libraries are told how many threads to use."""

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
