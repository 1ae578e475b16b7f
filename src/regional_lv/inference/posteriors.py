"""Files of posteriors (NetCDF, in groups as ArviZ names them)."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

Groups = Mapping[str, xr.Dataset]


def write(data: xr.DataTree, path: str | Path) -> None:
    """NetCDF, compressed; directories are made. Raises OSError where it cannot be written."""
    # HDF5 that cannot close its file, as on a full disk, ends the process: it works in memory.
    encoding = {
        f"/{group}": {
            name: {"zlib": True} for name, v in part.variables.items() if v.dtype.kind in "biufc"
        }
        for group, part in data.children.items()
    }
    content = data.to_netcdf(engine="h5netcdf", encoding=encoding)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_bytes(content)


def load(path: str | Path) -> xr.DataTree:
    """All groups of a file."""
    return xr.load_datatree(path, engine="h5netcdf")


def names_along(path: str | Path, dimension: str) -> list[str]:
    """Names along a dimension of the group `posterior` of a file, whose draws are not read."""
    with xr.open_dataset(path, group="posterior", engine="h5netcdf") as group:
        return [str(name) for name in group[dimension].to_numpy()]


def draws_by_name(
    group: xr.Dataset, variable: str, dimension: str, prefix: str = ""
) -> dict[str, np.ndarray]:
    """Draws (chain, draw) of a variable by the names along a dimension; none if it is absent."""
    if variable not in group:
        return {}
    values = group[variable].transpose(dimension, "chain", "draw").to_numpy()
    names = (f"{prefix}{name}" for name in group[dimension].to_numpy())
    return dict(zip(names, values, strict=True))
