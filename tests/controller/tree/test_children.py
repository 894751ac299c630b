"""Child processes are this program's, wherever the user stands."""

from controller.tree.children import Child, first_line


def test_a_folder_named_as_the_program_is_not_taken_for_it(tmp_path, monkeypatch):
    (tmp_path / "controller").mkdir()
    (tmp_path / "controller" / "__init__.py").write_text("raise SystemExit('not ours')")
    (tmp_path / "json.py").write_text("raise SystemExit('not ours')")
    monkeypatch.chdir(tmp_path)
    child = Child("main", ["controller.cli.main", "--version"], None)
    try:
        assert "haptic-wall" in (first_line(child, 30.0) or "")
    finally:
        child.dismiss(2.0)
