"""Markdown tables of what `matching.py`, `match_growth.py` and `match_startup.py` measured."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

Row = dict[str, Any]
OURS = ("graph_cut navigation", "graph_cut balanced", "graph_cut quality")
ROS, TUNED = "stereo_image_proc SGBM", "SGBM HH"
#: What the documents call them.
NAMES = {
    "graph_cut navigation": "`graph_cut`, effort `navigation`",
    "graph_cut balanced": "`graph_cut`, effort `balanced` (default)",
    "graph_cut quality": "`graph_cut`, effort `quality`",
    "kz2": "`kz2`, the paper's matcher",
    "SGBM 3WAY": "OpenCV SGBM 3WAY, tuned",
    "SGBM HH": "OpenCV SGBM HH, tuned",
    "SGBM + WLS": "OpenCV SGBM 3WAY + WLS filter",
    "stereo_image_proc SGBM": "SGBM as `stereo_image_proc` sets it",
    "stereo_image_proc BM": "BM as `stereo_image_proc` sets it",
}


def markdown(head: Iterable[str], lines: Iterable[Iterable[object]]) -> str:
    """A table."""
    head = list(head)
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join("| " + " | ".join(str(cell) for cell in row) + " |" for row in rows)


def mean(rows: Iterable[Row], key: str) -> float:
    """NaN where there is nothing to average."""
    values = [row[key] for row in rows if row[key] is not None]
    return float(np.mean(values)) if values else float("nan")


def fine(rows: Iterable[Row]) -> float:
    """Mean bad-0.5; tsukuba's truth is in whole pixels and says little of it."""
    return mean([row for row in rows if row["pair"] != "tsukuba"], "bad_0.5")


def occlusions(rows: list[Row]) -> str:
    """Mean precision and recall; those who give every pixel a disparity have neither."""
    found = [mean(rows, f"occlusion_{what}") for what in ("precision", "recall")]
    return " / ".join(f"{share:.2f}" for share in found) if any(found) else "-"


def select(rows: Iterable[Row], **keys: object) -> list[Row]:
    """Those with these values."""
    return [row for row in rows if all(row[key] == value for key, value in keys.items())]


def methods(rows: Iterable[Row]) -> list[str]:
    """In the order in which they were run."""
    return list(dict.fromkeys(row["method"] for row in rows))


def summary(rows: list[Row]) -> str:
    """One line a method, water and number of threads: means over the pairs."""
    head = ("method", "water", "threads", "bad-0.5 (without tsukuba)", "bad-1", "bad-2", "density %",
            "within sigma %", "wall s", "CPU s", "MB")  # fmt: skip
    keys = ("bad_1", "bad_2", "density_percent", "within_sigma_percent", "wall_s", "cpu_s")
    lines = []
    for method, water, threads in dict.fromkeys((r["method"], r["water"], r["threads"]) for r in rows):
        of = select(rows, method=method, water=water, threads=threads)
        cells = (f"{mean(of, key):.2f}".replace("nan", "") for key in keys)
        lines.append((method, water, threads, f"{fine(of):.2f}", *cells, f"{max(row['memory_mb'] for row in of):.0f}"))
    return markdown(head, lines)


def details(rows: list[Row]) -> str:
    """One line a run in air."""
    head = ("method", "pair", "threads", "bad-0.5 / 1 / 2", "occlusions P / R", "energy", "wall s", "CPU s")
    lines = []
    for r in select(rows, water="air"):
        bad = " / ".join(f"{r[f'bad_{x}']:.2f}" for x in ("0.5", "1", "2"))
        hidden = occlusions([r])
        energy = "" if r["energy"] is None else f"{r['energy']:.0f}"
        lines.append(
            (r["method"], r["pair"], r["threads"], bad, hidden, energy, f"{r['wall_s']:.3f}", f"{r['cpu_s']:.3f}")
        )
    return markdown(head, lines)


def in_air(rows: list[Row]) -> str:
    """The short table: accuracy and time in air."""
    head = ("matcher", "bad-0.5 (venus, teddy, cones)", "bad-1 (all four)", "occlusions P / R", "wall, two threads",
            "CPU, one thread", "MB")  # fmt: skip
    lines = []
    for method in methods(rows):
        of = select(rows, method=method, water="air")
        one, two = select(of, threads=1) or of, select(of, threads=2) or of
        memory = f"{max(row['memory_mb'] for row in two):.0f}"
        lines.append((
            NAMES.get(method, method), f"{fine(two):.1f}", f"{mean(two, 'bad_1'):.1f}", occlusions(two),
            f"{mean(two, 'wall_s'):.2g}", f"{mean(one, 'cpu_s'):.2g}", "-" if memory == "0" else memory,
        ))  # fmt: skip
    return markdown(head, lines)


def under_water(rows: list[Row]) -> str:
    """Mean bad-1 in each water, and how far the peers are behind: tuned SGBM, and as stereo_image_proc sets it."""
    waters = list(dict.fromkeys(row["water"] for row in rows))
    threads = max(row["threads"] for row in rows)

    def bad(method: str, water: str) -> float:
        return mean(select(rows, method=method, water=water, threads=threads), "bad_1")

    lines: list[tuple[str, ...]] = [
        (NAMES.get(method, method), *(f"{bad(method, water):.1f}" for water in waters)) for method in methods(rows)
    ]
    for mine in OURS[:2]:
        for peer in (TUNED, ROS):
            if {mine, peer} <= set(methods(rows)):
                leads = (f"{bad(peer, water) - bad(mine, water):+.1f}" for water in waters)
                lines.append((f"lead of `{mine.split()[1]}` over {NAMES[peer]}", *leads))
    return markdown(("bad-1, %", *waters), lines)


def everything(rows: list[Row]) -> str:
    """All tables."""
    return "\n\n".join(table(rows) for table in (in_air, under_water, summary, details)) + "\n"


def growth(rows: list[Row]) -> str:
    """CPU seconds on one thread, wall seconds on two, MB."""
    head = ("matcher", "pixels", "labels", "CPU s, one thread", "wall s, two", "ns a voxel", "MB")
    lines = []
    for one in (row for row in rows if row["threads"] == 1):
        key = {k: one[k] for k in ("method", "width", "height", "labels")}
        two = next(r for r in rows if r["threads"] == 2 and all(r[k] == v for k, v in key.items()))
        voxels = one["width"] * one["height"] * one["labels"]
        size = f"{one['width']} x {one['height']}"
        lines.append((one["method"], size, one["labels"], f"{one['cpu_s']:.2g}", f"{two['wall_s']:.2g}",
                       f"{1e9 * one['cpu_s'] / voxels:.0f}", f"{two['memory_mb']:.0f}"))  # fmt: skip
    return markdown(head, lines)


def hard_inputs(rows: list[Row]) -> str:
    """One line an input."""
    efforts = list(dict.fromkeys(row["effort"] for row in rows))
    head = ["input (450 x 375, 60 labels)", *(f"{e}: CPU s (over teddy's), planes to cut, density %" for e in efforts)]
    lines = []
    for name in dict.fromkeys(row["input"] for row in rows):
        of = [row for row in rows if row["input"] == name]
        cells = (f"{r['cpu_s']:.2g} ({r['over_teddy']:.1f}), {r['planes']}, {r['density_percent']:.0f}" for r in of)
        lines.append((name, *cells))
    return markdown(head, lines)


def startup(rows: list[Row]) -> str:
    """One line a situation."""
    head = ("a fresh process", "CPU s", "wall s", "compiled", "from the cache")
    return markdown(
        head, ((r["what"], f"{r['cpu_s']:.2g}", f"{r['wall_s']:.2g}", r["misses"], r["hits"]) for r in rows)
    )


def profile(found: dict[str, Any]) -> str:
    """A line a step of the matcher, a column a scene: CPU seconds and their share of the whole."""
    from matching_profile import INSIDE, STEPS

    titles = [title for title, *_ in STEPS]
    at = titles.index("moves") + 1
    titles[at:at] = [title for title, *_ in INSIDE]
    lines = [("all", *(f"{of['cpu_s']:.2f}" for of in found.values()))]
    for title in titles:
        seconds = [(of["steps_cpu_s"].get(title, 0.0), of["cpu_s"]) for of in found.values()]
        if any(part for part, _ in seconds):
            shown = title.replace("  ", "&nbsp;&nbsp;")
            lines.append((shown, *(f"{part:.3f} ({100 * part / whole:.0f} %)" for part, whole in seconds)))
    return markdown(("CPU s, one thread", *found), lines)
