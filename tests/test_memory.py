"""Memory that may still be taken."""

from pathlib import Path

import pytest

from graphnav.common import memory


def container(path: Path, most: str) -> Path:
    (path / "memory.max").write_text(f"{most}\n")
    (path / "memory.current").write_text("3000\n")
    (path / "memory.stat").write_text("anon 900\ninactive_file 1500\nactive_file 500\n")
    return path


@pytest.mark.parametrize(("most", "free"), [("4000", 3000), ("500", 0), ("max", memory.PLENTY)])
def test_what_a_container_caches_of_files_is_free(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: str, free: int
) -> None:
    monkeypatch.setattr(memory, "CGROUP", container(tmp_path, most))
    assert memory._of_container() == free
    assert memory.free_memory() <= free


def test_without_a_container_the_machine_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory, "CGROUP", tmp_path)
    assert memory._of_container() == memory.PLENTY
    assert 0 < memory.free_memory() < memory.PLENTY
