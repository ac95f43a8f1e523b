"""The files that hold the points of a sweep; a wrong one is found before numpy is loaded."""

from __future__ import annotations

from taction.system.output_files import check_file

PACKAGES = {  # by ending: the package and how to install it
    ".parquet": ("pyarrow", "Parquet needs pyarrow: pip install 'taction[parquet]'"),
    ".nc": ("xarray", "netCDF needs xarray: pip install 'taction[netcdf]'"),
}
ENDINGS = (".csv", *PACKAGES)


def check_sweep_export(path: str) -> None:
    """Refuse a file that could not be written, before any work is done.

    Raises
    ------
    InputError
        An unknown ending, a missing folder, or a package that is not installed.
    """
    check_file(path, "--export", ENDINGS, PACKAGES)
