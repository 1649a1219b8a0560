"""Picture of a recording without a screen or a graphics card.

    apt-get install -y --no-install-recommends mesa-vulkan-drivers libvulkan1
    python tools/screenshot_rrd.py run.rrd overview.png --at 600

Starts the rerun viewer headless on lavapipe (Vulkan in software), waits until the file is loaded,
puts the time cursor where asked, saves the window and ends the viewer it started. Needs rerun 0.41,
whose viewer client is marked experimental.
"""

import argparse
import os
import socket
import subprocess
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

SOFTWARE_VULKAN = Path("/usr/share/vulkan/icd.d/lvp_icd.x86_64.json")


def main() -> None:
    """Command line: recording, picture, time of the cursor, size."""
    parser = argparse.ArgumentParser(description="Screenshot of a rerun recording, headless.")
    parser.add_argument("recording", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument(
        "--at", type=float, default=0.0, help="time cursor [s] from the run's start"
    )
    parser.add_argument("--size", default="1600x900", help="window, WIDTHxHEIGHT")
    parser.add_argument("--settle", type=float, default=6.0, help="seconds to wait for the drawing")
    options = parser.parse_args()
    shoot(options.recording, options.picture, options.at, options.size, options.settle)


def shoot(recording: Path, picture: Path, at: float, size: str, settle: float) -> None:
    """Open `recording` in a viewer of its own and save its window as `picture` (PNG)."""
    if not recording.is_file():
        raise SystemExit(f"{recording}: no such file")
    port = _free_port()
    viewer = subprocess.Popen(_command(recording, size, port), env=_environment())
    try:
        _save(port, picture, at, settle)
    finally:
        viewer.terminate()
        viewer.wait(timeout=20)


def _command(recording: Path, size: str, port: int) -> list[str]:
    package = find_spec("rerun_cli")
    if package is None or package.origin is None:
        raise SystemExit("no rerun viewer in this Python: pip install rerun-sdk")
    # the program itself: `bin/rerun` is a wrapper, and ending that orphans the viewer
    program = Path(package.origin).parent / "rerun"
    where = ["--bind", "127.0.0.1", "--port", str(port)]
    return [str(program), "--headless", "--window-size", size, *where, str(recording)]


def _environment() -> dict[str, str]:
    quiet = {"CI": "true"}  # no analytics
    software = {"WGPU_BACKEND": "vulkan", "VK_ICD_FILENAMES": str(SOFTWARE_VULKAN)}
    return dict(os.environ) | quiet | (software if SOFTWARE_VULKAN.exists() else {})


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _save(port: int, picture: Path, at: float, settle: float) -> None:
    from rerun.experimental import ViewerClient

    address = f"rerun+http://127.0.0.1:{port}/proxy"
    client = _patiently(lambda: ViewerClient.connect(address))
    _patiently(lambda: client.set_time("time", duration=at, play_state="paused"))
    while client.get_state().loading:
        time.sleep(0.3)
    client.set_time("time", duration=at, play_state="paused")
    time.sleep(settle)
    client.save_screenshot(str(picture))


def _patiently(ask: Callable[[], Any], limit: float = 60.0) -> Any:
    """Repeat while the viewer is still starting or has not opened the file yet."""
    deadline = time.monotonic() + limit
    while True:
        try:
            return ask()
        except ConnectionError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.3)


if __name__ == "__main__":
    main()
