"""Sheets of Excel and its kin: the first sheet with a table, read as text is."""

from __future__ import annotations

import zipfile
from pathlib import Path

from hexsim.errors import HexsimError
from hexsim.readers.formats.text import Cells
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import RawLog, Reader
from hexsim.readers.text_table import find_table


class ExcelReader(Reader):
    """A table wherever it begins in the first sheet that has one, dates as time stamps. Text is written down and read as
    the text format reads it, so that names, units and odd cells are found by the same rules."""

    name = "Excel sheet"
    suffixes = (".xlsx", ".xlsm")
    needs = "excel"

    def read(
        self,
        path: Path,
        layout: FileLayout,
        *,
        most_bytes: int = 150_000_000,  # bytes of XML, unpacked: a cell takes about as much again in memory
    ) -> RawLog:
        import fastexcel

        with zipfile.ZipFile(path) as archive:
            size = sum(info.file_size for info in archive.infolist())
        if size > most_bytes:
            raise HexsimError(
                f"{path} unpacks to {size / 1e6:.0f} MB, {most_bytes / 1e6:.0f} are the most: save it as CSV"
            )
        book = fastexcel.read_excel(path)
        said = []
        for name in book.sheet_names:
            sheet = book.load_sheet(name, header_row=None, dtypes="string").to_polars()
            if sheet.height < 3:
                said.append(f"sheet {name} has {sheet.height} rows")
                continue
            text = sheet.write_csv(include_header=False, separator="\t", quote_style="necessary")
            try:
                table = find_table(text.splitlines()[:2000], layout, path)
            except HexsimError as error:
                said.append(f"sheet {name}: {error}")
                continue
            raw = RawLog(signals=[], left_out=said, first_row=table.first + 1)
            rows = text.split("\n", table.first)[-1]
            Cells(path=path, table=table, comment=layout.comment).read(rows.encode(), raw)
            if raw.signals:
                return raw
        raise HexsimError(f"{path} has no sheet with a table: {'; '.join(said[:6]) or 'it is empty'}")


READER = ExcelReader()
