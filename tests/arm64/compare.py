"""Compares digests on this machine with those on an emulated arm64: python tests/arm64/compare.py [--folder out/arm64].

Both train by each rule, align recordings of others and check the golden cases, as `exact_digests.py` has it. It prints
a line for each result; exit status 0 if all are equal and every golden case holds, 1 if not, 2 if something is missing
to try it with. The first run fetches some 300 MB into the folder; later ones fetch nothing.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from emulated_machine import EmulatedMachine, MissingError
from exact_digests import write_inputs

_SCRIPT = Path(__file__).with_name("exact_digests.py")


def results(command: list[str], inputs: Path, **options: Any) -> Iterator[dict[str, Any]]:
    """Run the script on a machine, and yield its lines as they come."""
    with tempfile.TemporaryDirectory() as out:
        with subprocess.Popen([*command, str(inputs), out], stdout=subprocess.PIPE, text=True, **options) as process:
            assert process.stdout is not None
            yield from map(json.loads, process.stdout)
        if process.returncode:
            raise SystemExit(f"{' '.join(command)}: ended with status {process.returncode}")


def compare(machine: EmulatedMachine, inputs: Path) -> bool:
    """Return whether all is equal and holds, and print a line for each result."""
    here = {line["name"]: line["result"] for line in results([sys.executable, str(_SCRIPT)], inputs)}
    holds, there = True, set()
    for line in results(machine.command(_SCRIPT), inputs, env=machine.environment):
        name, result = line["name"], line["result"]
        there.add(name)
        same = here.get(name) == result
        holds = holds and same and (not name.startswith("golden: ") or result["status"] == "passed")
        print(
            "  ".join(filter(None, ("equal  " if same else "DIFFERS", name, _short(result), line["note"]))), flush=True
        )
        if not same:
            print(f"         here: {json.dumps(here.get(name))}\n         arm64: {json.dumps(result)}", flush=True)
    return holds and there == set(here)


def _short(result: Any) -> str:
    if isinstance(result, str):
        return result[:12]
    return f"{result['digest'][:12]} after {result['steps']} steps" if "digest" in result else str(result["status"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=Path("out/arm64"), help="where the machine is kept")
    folder = parser.parse_args().folder.resolve()
    machine = EmulatedMachine(folder)
    try:
        machine.make()
    except MissingError as error:
        print(f"test-arm64: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    inputs = folder / "inputs"
    shutil.rmtree(inputs, ignore_errors=True)
    inputs.mkdir()
    write_inputs(inputs)
    os.environ.setdefault("NUMBA_CACHE_DIR", str(folder / "numba_here"))
    raise SystemExit(0 if compare(machine, inputs) else 1)


if __name__ == "__main__":
    main()
