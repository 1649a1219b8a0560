"""How much memory this process may still take."""

import os
from pathlib import Path

PLENTY = 1 << 62
MEMINFO = Path("/proc/meminfo")
CGROUP = Path("/sys/fs/cgroup")


def free_memory() -> int:
    """Bytes: what the machine, the container and the process' own limit leave, the least."""
    return min(_of_machine(), _of_container(), _of_limit())


def _of_machine() -> int:
    try:
        line = next(x for x in MEMINFO.read_text().splitlines() if x.startswith("MemAvailable"))
        return int(line.split()[1]) * 1024
    except (OSError, StopIteration, ValueError):
        try:
            return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        except (AttributeError, ValueError, OSError):  # Windows
            return PLENTY


def _of_container() -> int:
    try:
        most = (CGROUP / "memory.max").read_text().strip()
        if most == "max":
            return PLENTY
        used = int((CGROUP / "memory.current").read_text())
        stat = dict(line.split() for line in (CGROUP / "memory.stat").read_text().splitlines())
        cached = int(stat["inactive_file"]) + int(stat["active_file"])  # given back when asked
        return max(0, int(most) - max(0, used - cached))
    except (OSError, ValueError, KeyError):
        return PLENTY


def _of_limit() -> int:
    try:
        import resource

        soft = resource.getrlimit(resource.RLIMIT_AS)[0]
        used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (ImportError, OSError, ValueError):
        return PLENTY
    return PLENTY if soft == resource.RLIM_INFINITY else max(0, soft - used)
