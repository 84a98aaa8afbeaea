"""The one import of h5py, after telling HDF5 to load no filter plugins a file may ask for."""

import os

os.environ["HDF5_PLUGIN_PRELOAD"] = "::"  # read by HDF5 when it is loaded

import h5py  # type: ignore[import-untyped]

__all__ = ["h5py"]
