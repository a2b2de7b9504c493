"""DIC programs whose exports are recognised by their content: one file each, found by itself."""

from __future__ import annotations

import importlib
import pkgutil

from studies.importers.vendors.vendor import Vendor

__all__ = ["Vendor", "vendors"]


def vendors() -> list[Vendor]:
    """One of every kind, by name."""
    for module in pkgutil.iter_modules(__path__, f"{__name__}."):
        importlib.import_module(module.name)
    return sorted((kind() for kind in Vendor.__subclasses__()), key=lambda vendor: vendor.name)
