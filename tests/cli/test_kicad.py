"""``taction kicad``: the folder of a project."""

from __future__ import annotations

from pathlib import Path

from tests.support.paths import SCENES
from tests.support.running import document, taction

CUSTOM = str(SCENES / "custom-matrix.toml")


def test_the_folder_holds_a_project(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "board"
    found = document(taction("kicad", CUSTOM, "-o", str(folder), "--channel", "2", "--json"))
    assert {Path(name).name for name in found["files"]} == {
        "custom-matrix-channel-2.kicad_sch",
        "custom-matrix-channel-2.kicad_pro",
        "custom-matrix.kicad_sym",
        "sym-lib-table",
        "custom-matrix-bom.csv",
    }
    assert all(Path(name).is_file() for name in found["files"])
    assert (found["channel"], found["row"]) == (2, 2)
    assert any("stray" in text for text in found["not_drawn"])
    # A second channel of the board goes beside the first.
    assert taction("kicad", CUSTOM, "-o", str(folder), "--channel", "1").exit_code == 0
    assert len(list(folder.glob("*.kicad_sch"))) == 2


def test_another_project_is_not_damaged(tmp_path: Path) -> None:
    table = tmp_path / "sym-lib-table"
    table.write_text("(sym_lib_table (version 7))\n")
    result = taction("kicad", CUSTOM, "-o", str(tmp_path))
    assert result.exit_code == 2
    assert "give another folder" in result.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["sym-lib-table"]
    assert table.read_text() == "(sym_lib_table (version 7))\n"


def test_what_cannot_be_drawn_is_refused_before_a_folder_is_made(tmp_path: Path) -> None:
    result = taction("kicad", CUSTOM, "-o", str(tmp_path / "new"), "--channel", "9")
    assert result.exit_code == 2
    assert "4 channels, counted from 1" in result.stderr
    assert not (tmp_path / "new").exists()
    (tmp_path / "file").touch()
    result = taction("kicad", CUSTOM, "-o", str(tmp_path / "file" / "below"))
    assert result.exit_code == 2
    assert "cannot be made" in result.stderr
