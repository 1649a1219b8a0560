"""Errors put into the code on purpose, one at a time: do the tests see them?

    python tools/mutants.py                 # all of them
    python tools/mutants.py noise bend      # those whose name contains a word
    python tools/mutants.py --list

Each mutant changes one line of a copy of the repository and runs the tests that should fail; a
mutant that lives is printed last and ends with status 1. Run by hand after a change of the
equations: some minutes.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COPIED = ("factors", "graphnav", "tests", "tools", "pyproject.toml", "README.md", "docs")


@dataclass(frozen=True)
class Mutant:
    """One line changed."""

    name: str
    file: str
    line: str  # stands in the file once
    wrong: str  # what stands there instead
    tests: str  # that should fail, names in tests/ without "test_"


def _of(file: str, tests: str, *changes: tuple[str, str, str]) -> list[Mutant]:
    return [Mutant(name, file, line, wrong, tests) for name, line, wrong in changes]


MUTANTS = [
    *_of(
        "factors/displacement.py",
        "motion_truth running_gear factors",
        (
            "gauge sign",
            "D = gain.value[:, None] * travel - model",
            "D = gain.value[:, None] * travel + model",
        ),
        ("cornering sign in D", "sideways = sideways - c", "sideways = sideways + c"),
        ("lateral sign in D", "D = D - so3.mv(sideways, ex)", "D = D + so3.mv(sideways, ex)"),
        ("delay sign in D", "late = c[:, delay] - sums.delay", "late = sums.delay - c[:, delay]"),
        ("lever sign", "moved + arm - lever - D.total", "moved - arm + lever - D.total"),
        ("phase sign", "r[:, 1] += x.phase", "r[:, 1] -= x.phase"),
        ("phase prior", "pulse / np.sqrt(12), 1e-5", "pulse / 12, 1e-5"),
    ),
    *_of(
        "factors/odometer_model.py",
        "motion_truth factors",
        ("scale sign", "self.forward.value(c), 1 + c[", "self.forward.value(c), 1 - c["),
        (
            "coefficient's derivative",
            "J_c[self.on, :, self.column] +=",
            "J_c[self.on, :, self.column] -=",
        ),
        ("units by the scale", "by_gain / gain.scale[:, None]", "by_gain / gain.value[:, None]"),
        ("sign of the odometer's units", "by_gain, J_c = -r", "by_gain, J_c = r"),
    ),
    *_of(
        "factors/mounting.py",
        "factors motion_truth",
        (
            "pitch and heading exchanged",
            "right_jacobian(vector)[:, :, [0, 2]]",
            "right_jacobian(vector)[:, :, [2, 0]]",
        ),
    ),
    *_of(
        "graphnav/inertial/odometer_steps.py",
        "motion_truth",
        ("tyre slip bend sign", "bend=total(steps.distance", "bend=total(-steps.distance"),
        ("Earth rate sign in the displacement", "* sensed - earth_b", "* sensed + earth_b"),
        ("Earth rate sign in the yaw", "2] - earth_z *", "2] + earth_z *"),
        (
            "delay sign of the steps",
            "distance_at(odometer, true.edge + delay)",
            "distance_at(odometer, true.edge - delay)",
        ),
    ),
    *_of(
        "factors/velocity.py",
        "motion_truth factors",
        ("lateral sign of velocity", "lateral = -model.lateral", "lateral = model.lateral"),
        ("delay sign of the speed's change", "speed + (c[:, delay]", "speed - (c[:, delay]"),
        ("lever sign of velocity", "v_b + so3.cross(rate_b", "v_b - so3.cross(rate_b"),
    ),
    *_of(
        "factors/side_slope.py",
        "side_slope factors",
        ("side slope's sign", "r[:, 0] -= slides", "r[:, 0] += slides"),
        ("side slope by the attitude", "J_x[:, 0, ROTATION] -=", "J_x[:, 0, ROTATION] +="),
    ),
    *_of(
        "factors/track_width.py",
        "factors motion_truth",
        ("track width sign", "(difference - width", "(difference + width"),
    ),
    *_of(
        "factors/position.py",
        "factors satellite_fixes",
        ("fix delay sign", "- _per(late) * v_a + c", "+ _per(late) * v_a + c"),
        ("antenna sign", "arm = by.swing + so3.mv", "arm = by.swing - so3.mv"),
    ),
    *_of(
        "factors/inertial.py",
        "factors inertial_truth",
        ("Coriolis sign", "a = R @ dv - so3.cross(Omega", "a = R @ dv + so3.cross(Omega"),
        ("gravity gradient", "-2 * turn - sag * T / 2", "-2 * turn + sag * T / 2"),
        ("errors Jacobian", "pre.dp_de) - pre.dv_de", "pre.dp_de) + pre.dv_de"),
    ),
    *_of(
        "factors/preintegration.py",
        "preintegration",
        ("half of the bias in position", "- 0.5 * push * dt", "- push * dt"),
        ("whitening of velocity with angle", "c(T**2 / 2) * FG\n", "c(T**2) * FG\n"),
    ),
    *_of(
        "factors/calibration.py",
        "running_gear calibration_chain",
        ("walk without sqrt", "layout.walk[rows] * np.sqrt(dt))", "layout.walk[rows] * dt)"),
        ("constants wander", "CONSTANT * c.sd if", "c.sd if"),
    ),
    *_of(
        "factors/weights.py",
        "weights",
        ("IGG III without its square", "k0 / np.maximum(u, k0) * fading", "k0 / np.maximum(u, k0)"),
    ),
    *_of(
        "factors/heading.py",
        "factors",
        ("heading not wrapped", "(error + np.pi) % (2 * np.pi) - np.pi", "error"),
    ),
    *_of(
        "graphnav/graph/nodes.py",
        "running_gear nodes",
        (
            "segment of the next interval",
            "np.maximum(node - 1, 0)",
            "np.minimum(node, len(self.segment) - 1)",
        ),
        (
            "nearest node's time sign",
            "return index, times - nodes.time[index]",
            "return index, nodes.time[index] - times",
        ),
        (
            "events ahead of a grid node",
            "by.edge[event] - by.edge[found] < by.ahead - 1e-9",
            "by.edge[event] - by.edge[found] < -1e-9",
        ),
        ("middle of a segment", "+ 0.5) * SEGMENT_S", "+ 0.25) * SEGMENT_S"),
    ),
    *_of(
        "graphnav/graph/motion.py",
        "running_gear",
        ("delay sign of velocity", "scope.time + delay_of", "scope.time - delay_of"),
    ),
    *_of(
        "graphnav/graph/noise.py",
        "noise",
        (
            "noise: correlation dropped",
            "ratio = 1 + 2 * np.sum(taper",
            "ratio = 1 + 0 * np.sum(taper",
        ),
        ("noise: redundancy dropped", "out[k] = 1 - np.einsum", "out[k] = 1 - 0 * np.einsum"),
    ),
    *_of(
        "graphnav/graph/motion_noise.py",
        "running_gear noise",
        ("noise: sigma T for sqrt(T)", "0.0) * np.sqrt(T)[:, None]", "0.0) * T[:, None]"),
    ),
    *_of(
        "graphnav/graph/assembly.py",
        "running_gear incremental",
        (
            "foreign segments taken",
            "assert np.array_equal(term.index[on], segment[owner])",
            "assert True",
        ),
        ("foreign nodes taken", "assert np.isin(which, (0, 1)).all()", "assert True"),
    ),
    *_of(
        "graphnav/recognition/corrections.py",
        "corrections",
        ("kappa 0.01", "KAPPA, KAPPA_SD = 0.10", "KAPPA, KAPPA_SD = 0.01"),
        ("half gauge", "vehicle.track_gauge / 2.0", "vehicle.track_gauge"),
    ),
    *_of(
        "graphnav/result/trajectory.py",
        "trajectory",
        (
            "roll and pitch sd swapped",
            "np.stack([f_n, r_n, up_n], 1)",
            "np.stack([r_n, f_n, up_n], 1)",
        ),
    ),
    *_of(
        "graphnav/result/compare.py",
        "compare",
        ("distance of the error", "1000 * worst / distance", "1000 * _rms(horizontal) / distance"),
    ),
    *_of(
        "graphnav/result/events.py",
        "events",
        ("spin and lock swapped", '"wheel_spin" if peak > 0', '"wheel_spin" if peak < 0'),
    ),
    *_of(
        "graphnav/common/earth.py",
        "earth",
        ("gravity grows with height", "surface * (1 - 2 * h", "surface * (1 + 2 * h"),
        ("Schuler sign", "np.diag([-1.0, -1.0, 2.0])", "np.diag([1.0, 1.0, 2.0])"),
    ),
    *_of(
        "graphnav/recognition/viterbi.py",
        "viterbi",
        ("dwell forgotten", "wait = chain.dwell - 1", "wait = chain.dwell"),
    ),
    *_of(
        "graphnav/graph/densify.py",
        "densify",
        (
            "gap of the velocity",
            "rise_v, slope_v = 6 * s * (1 - s) / T, s",
            "rise_v, slope_v = 3 * s * (1 - s) / T, s",
        ),
    ),
    *_of(
        "factors/rover_wheels.py",
        "wheel_factors",
        ("centroid swing", "residual = q + Qc - c_i", "residual = q - Qc + c_i"),
        ("toe sign", "- stray * sums.ahead)", "+ stray * sums.ahead)"),
    ),
]


def killed(mutant: Mutant, copy: Path) -> bool:
    """Whether a test fails on a mutant."""
    file = copy / mutant.file
    right = file.read_text(encoding="utf-8")
    if right.count(mutant.line) != 1:
        raise SystemExit(f"{mutant.name}: {mutant.line!r} stands {right.count(mutant.line)} times")
    file.write_text(right.replace(mutant.line, mutant.wrong), encoding="utf-8")
    tests = [f"tests/test_{name}.py" for name in mutant.tests.split()]
    words = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    clean = os.environ | {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(words, cwd=copy, env=clean, capture_output=True, check=False)
    finally:
        file.write_text(right, encoding="utf-8")
    if done.returncode not in (0, 1):
        raise SystemExit(f"{mutant.name}: pytest broke\n{done.stdout.decode()[-2000:]}")
    return done.returncode == 1


def main() -> int:
    """Run the mutants asked for; 1 when one of them lives."""
    ask = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    ask.add_argument("words", nargs="*", help="only mutants whose name contains one of these")
    ask.add_argument("--list", action="store_true")
    asked = ask.parse_args()
    chosen = [m for m in MUTANTS if not asked.words or any(w in m.name for w in asked.words)]
    if asked.list:
        print(*(f"{m.name:40} {m.file}" for m in chosen), sep="\n")
        return 0
    alive = []
    with tempfile.TemporaryDirectory() as scratch:
        copy = Path(scratch)
        for name in COPIED:
            source = ROOT / name
            if source.is_dir():
                shutil.copytree(source, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(source, copy / name)
        for mutant in chosen:
            dead = killed(mutant, copy)
            print(f"{'killed' if dead else 'LIVES':7} {mutant.name}", flush=True)
            alive += [] if dead else [mutant.name]
    print(f"{len(chosen) - len(alive)} of {len(chosen)} killed", *alive, sep="\n  ")
    return int(bool(alive))


if __name__ == "__main__":
    sys.exit(main())
