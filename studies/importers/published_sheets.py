"""The published printed elastomer sheets, by name: found or fetched by `measured_data`, read as any packed sheet."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from studies.importers import measured_data
from studies.importers.printed_sheets import PrintedSheets
from studies.importers.recording.importer import Importer, Recording, SheetOptions


class PublishedSheets(Importer):
    """A name in `measured_data.SHEETS`, unless a file or folder of that name is there."""

    source: ClassVar[str] = f"a published sheet ({', '.join(measured_data.SHEETS)})"

    def reads(self, source: str) -> bool:
        """Whether it is such a name."""
        return source in measured_data.SHEETS and not Path(source).exists()

    def read(self, source: str, options: SheetOptions, name: str | None, record: Path | None) -> Recording:
        """Raises `DataNotFoundError` where it is neither there nor to be fetched."""
        return PrintedSheets().read(str(measured_data.sheet(source)), options, name, record)
