"""The notebook and the examples of the documentation run as they are."""

import pathlib
import re

import nbformat
import pytest
from conftest import ROOT, Turn
from nbclient import NotebookClient

EXAMPLES = ROOT / "python" / "examples"


def test_the_notebook_goes_from_frames_to_figures_in_an_empty_folder(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    notebook = nbformat.read(EXAMPLES / "turn.ipynb", as_version=4)  # type: ignore[no-untyped-call]
    # Only what is installed: nothing of the sources is beside it or on the path.
    monkeypatch.delenv("PYTHONPATH", raising=False)
    NotebookClient(notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}).execute()
    pictures = [o for cell in notebook.cells if cell.cell_type == "code" for o in cell.outputs if "image/png" in o.get("data", {})]
    assert len(pictures) == 2
    assert all(len(picture["data"]["image/png"]) > 10_000 for picture in pictures)
    assert list(tmp_path.iterdir()) == []


def test_the_examples_of_the_page_run(frames: Turn, recording: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (ROOT / "docs" / "python.md").read_text()
    examples = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert len(examples) >= 4
    monkeypatch.chdir(frames.folder.parent)
    for name, target in (("frames", frames.folder), ("A01", recording)):
        link = frames.folder.parent / name
        if not link.exists():
            link.symlink_to(target)
    space: dict[str, object] = {}
    for example in examples:
        exec(compile(example, "docs/python.md", "exec"), space)
