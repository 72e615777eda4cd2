"""The fuzzer's side of `test_fuzz.py`: python tests/support/fuzz_reader.py [libFuzzer's options] [CORPUS].

Every input is a log, which begins as one. Whatever is raised that is no LogError ends the run, and so does taking long
or much memory.
"""

import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).parents[2]))

with atheris.instrument_imports(include=["recorders", "mcap"]):
    from recorders.errors import LogError
    from recorders.mcap_format import records as mcap_records
    from recorders.reading.reader import LogReader


def ask_everything(path: Path) -> None:
    """Ask a log for all that it has."""
    reader = LogReader(path)
    for ask in (
        lambda: sum(1 for _ in reader),
        lambda: sum(1 for _ in reader.records(topics=["/topic/1"], start_ns=5, end_ns=2**62)),
        lambda: (reader.counts, reader.topics),
        lambda: reader.manifest,
        lambda: [reader.attachment(name) for name in reader.attachments],
        lambda: reader.protected,
    ):
        with suppress(LogError):
            ask()


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"

        def one_input(raw: bytes) -> None:
            path.write_bytes(mcap_records.MAGIC + raw[len(mcap_records.MAGIC) :])
            with suppress(LogError):
                ask_everything(path)

        atheris.Setup(sys.argv, one_input)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
