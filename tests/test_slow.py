"""The list of tests that a run leaves out names tests that exist, each once and in order."""

from pathlib import Path

LIST = Path(__file__).with_name("slow.txt")


def test_every_line_names_a_test():
    lines = [line for line in LIST.read_text().splitlines() if not line.startswith("#")]
    assert lines == sorted(set(lines))
    for line in lines:
        file, _, name = line.partition("::")
        text = (LIST.parents[1] / file).read_text(encoding="utf-8")
        assert f"\ndef {name.split('[')[0]}(" in text, line
