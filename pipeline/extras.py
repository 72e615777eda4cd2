"""Packages that only some verbs need, by the extra that installs them."""

from recorders.errors import MissingExtra

EXTRAS = {
    "pydrake": "sim",
    "scipy": "sim",
    "rerun": "view",
    "matplotlib": "view",
    "distributed": "dask",
    "viser": "browser",
    "prometheus_client": "metrics",
    "google": "foxglove",
    "mcap_protobuf": "foxglove",
    "pyarrow": "parquet",
}


def missing_extra(error: ModuleNotFoundError) -> MissingExtra | None:
    """Return the error that names the extra for a module that was not found; None if no extra installs it."""
    package = (error.name or "").partition(".")[0]
    extra = EXTRAS.get(package)
    return None if extra is None else MissingExtra(package, extra)
