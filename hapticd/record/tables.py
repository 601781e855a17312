"""A run as the tables that others compute with: pandas and xarray, units in their attributes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from hapticd.record.metadata import to_plain
from hapticd.record.schema import COLUMNS

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from numpy.typing import NDArray

    Columns = Mapping[str, NDArray[Any]]

_DESCRIPTIONS = {column.name: column.description for column in COLUMNS}
_INDEX = "time_s"


def to_pandas(columns: Columns, units: Mapping[str, str], name: str) -> pd.DataFrame:
    """See `Run.to_pandas`."""
    import pandas as pd

    frame = pd.DataFrame({column: values for column, values in columns.items() if column != _INDEX})
    frame.index = pd.Index(columns[_INDEX], name=_INDEX)
    frame.attrs = {"units": dict(units), "run": name}
    return frame


def to_xarray(columns: Columns, units: Mapping[str, str], described: Mapping[str, Any]) -> xr.Dataset:
    """See `Run.to_xarray`.

    Raises:
        ImportError: xarray is not installed.
    """
    try:
        import xarray as xr
    except ImportError as error:
        raise ImportError("Run.to_xarray needs xarray: pip install 'hapticd[xarray]'") from error

    def attributes(name: str) -> dict[str, str]:
        known = {"units": units.get(name), "long_name": _DESCRIPTIONS.get(name)}
        return {key: value for key, value in known.items() if value is not None}

    data = {name: (_INDEX, values, attributes(name)) for name, values in columns.items() if name != _INDEX}
    time = {_INDEX: (_INDEX, columns[_INDEX], attributes(_INDEX))}
    # netCDF knows text and numbers only: what is nested goes as JSON, as in the run file itself
    texts = {key: value if isinstance(value, str) else json.dumps(to_plain(value)) for key, value in described.items()}
    return xr.Dataset(data, time, texts)
