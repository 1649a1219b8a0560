"""Is the IMU's noise found as it was injected? By axis, standing and driving apart.

    python tools/noise_check.py field-skid field-wheeled --seeds 1-3 --gnss
    python tools/noise_check.py wheeled --noise 100 --gnss        # white, 100 times the data sheet
    python tools/noise_check.py field-wheeled --vibration 3 --sampled --rate 20 --gnss

Found is `solver.imu_noise` of summary.json, injected is `noise` of truth_calibration.json over 1 s,
the smoother's interval. Asked: within 1.5 of each other.
"""

import argparse
import json
import sys
from typing import Any

import numpy as np
from rich.box import MARKDOWN
from rich.console import Console
from rich.table import Table
from simulated_runs import add_options, run_of
from smoothed_runs import NoResult, smoothed

SENSORS = {"gyro_deg_sqrt_h": "gyro", "accel_mg_sqrt_hz": "accel"}
INTERVAL_S = "1"  # of the injected levels, the smoother's
ASKED = 1.5


def ratios(found: dict[str, Any], injected: dict[str, Any]) -> dict[tuple[str, str], list[float]]:
    """Found over injected noise of x, y, z by (standing | driving, gyro | accel)."""
    out = {}
    for moving, levels in injected.items():
        for unit, sensor in SENSORS.items():
            true = levels[unit].get(INTERVAL_S)
            found_axes = found.get(moving, {}).get(unit)
            if true and found_axes:
                out[moving, sensor] = [float(a / b) for a, b in zip(found_axes, true, strict=True)]
    return out


def main() -> None:
    """Command line; exit status 1 where anything is further off than asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenarios", nargs="+", metavar="SCENARIO")
    add_options(parser, "1-3")
    parser.add_argument("--gnss", action="store_true", help="satellite fixes too")
    options = parser.parse_args()
    table, factors = Table(box=MARKDOWN), list[float]()
    for title in ("run", "", "", "found over injected: x", "y", "z"):
        table.add_column(title)
    for scenario in options.scenarios:
        for seed in options.seeds:
            directory = run_of(options, scenario, seed)
            injected = json.loads((directory / "truth_calibration.json").read_text())["noise"]
            try:
                result = smoothed(directory / "run.csv.gz", directory / "vehicle.toml")
            except NoResult as error:
                print(f"{scenario}, seed {seed}: {error}", file=sys.stderr)
                continue
            found = ratios(result.summary["solver"].get("imu_noise", {}), injected)
            if not found:
                print(f"{scenario}, seed {seed}: no IMU noise is told", file=sys.stderr)
            for (moving, sensor), by_axis in found.items():
                factors += np.exp(np.abs(np.log(by_axis))).tolist()
                cells = (f"{x:.2f}" for x in by_axis)
                table.add_row(f"{scenario} {seed}", moving, sensor, *cells)
    if not factors:
        sys.exit("nothing to compare")
    Console(width=120).print(table)
    print(f"furthest off: a factor of {max(factors):.2f}")
    sys.exit(max(factors) > ASKED)


if __name__ == "__main__":
    main()
