"""Tables of the README and of pages in docs/, written from the results.

    python -m benchmarks tables            # write them
    python -m benchmarks tables --check    # check that they match the results

A benchmark without a result has no table.
"""

from __future__ import annotations

import json
import re
import statistics
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

from benchmarks.claims import claims
from benchmarks.formatting import number, table, within
from benchmarks.registry import GROUPS
from benchmarks.session import RESULTS, Session, duration
from benchmarks.study_page import page as study_page
from benchmarks.study_tables import STUDIES
from benchmarks.summary import summary
from bricksrl.errors import RunError, percent
from bricksrl.evaluation.statistics import FEWEST_SEEDS

Result: TypeAlias = dict[str, Any]
ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "results.md"
STUDIES_PAGE = ROOT / "docs" / "studies.md"
README = ROOT / "README.md"
BENCHMARKS_PAGE = ROOT / "docs" / "benchmarks.md"
VIRTUAL_HUB_PAGE = ROOT / "docs" / "virtual_hub.md"
ARCHITECTURE_PAGE = ROOT / "docs" / "architecture.md"
PAPER_PAGE = ROOT / "docs" / "paper.md"
SHOWN_MARKS = (250, 500, 1000, 2500, 7500)
"""Robot steps that the page shows; the results have more."""
PROGRAMS = {
    "tasks": "tasks that interrupt each other's motors and drive base",
    "motors": "commands and settings of two motors, in any order",
    "motors-branching": "the same, with a branch after each line that takes time",
    "drives": "commands and settings of a drive base, in any order",
    "drives-branching": "the same, with a branch after each line that takes time",
}
BLOCK = re.compile(r"(?<=<!-- benchmarks/tables.py -->\n).*?(?=<!-- end -->)", re.DOTALL)
HEAD = """# Results

This page is written by `python -m benchmarks tables` from `benchmarks/results/`, where each result lies with the processor and
the versions it was measured with. Square brackets are 95 % bootstrap intervals over seeds (for rates: Wilson intervals). All
robots are virtual; nobody here has run this on LEGO's yet. The returns of SAC on each robot, of
random actions, hand-written controllers, gaits and teachers are of today's virtual robots; other trainings on robots are of those
before they had these motors, links and sensors. With them some tasks are harder than they were: an exchange takes 90 ms in place
of 40 and is sometimes late or lost, so LineFollow-v0 steps in 90 ms instead of 60 (59 in place of 67), and of Park-v0 30 episodes
are few (81 % in place of 100 %; batches of 256 gave 70 to 95 % there). In the simulations SAC learned with today's settings; TD3,
CrossQ, DroQ and REDQ on WalkerSim-v0, the ablation there and the literature are of before batches were mirrored.

Learning from the expert datasets, TD3 and SAC fail on Walker-v0 and RoboArm-v0, as in the paper: nothing holds their critics back
where the dataset has no actions, and ours has fewer of them. Its Walker makes hardly a mistake, and its arm arrives after 2 steps
instead of 13, which leaves 224 transitions instead of 1,297; so TD3 is below the paper there, and BC and IQL reach the arm's goal
less surely in some seeds. With the default settings CQL does worse on these 224 transitions than with the paper's. Spinning-v0's
greatest return is lower than the paper's since our robot turns more slowly.

Learning from the random datasets, BC imitates random actions without their noise: its returns are as poor as theirs and
differ by seed, and are below the paper's on RunAway-v0 and RoboArm-v0. With the paper's settings IQL and CQL are below the
paper's on RoboArm-v0. There CQL depends on which random episodes were recorded: on two other datasets (`bricksrl record
RoboArm-v0 --policy random --episodes 100 --seed N`, then `bricksrl train-offline RoboArm-v0 --agent cql --preset paper
--updates 10000`) one seed each gave -67 and -93. With the default settings CQL is above the paper's on all four.
"""  # noqa: E501

STUDIES_HEAD = """# Studies

A study is a table of trainings with several seeds. In a clone of the repository `python -m benchmarks` lists the studies and the other
[benchmarks](benchmarks.md), and `python -m benchmarks NAME` runs one. With `--quick` it takes a few minutes, to check that everything
works. This page is written by `python -m benchmarks tables` from the studies that were run at full length
(`benchmarks/results/study_*.json`), all but `paper` and `drawn-worlds` before the virtual robots had today's motors, links and
sensors. The studies
`offline`, `datasets` and `ablation` show results of benchmarks, which are in [results.md](results.md). Wall minutes are those of
a computer that had other work, too.

`paper` grows as it is run: a cell with fewer than five seeds is not at its end. RoboArm_mixed-v0 was trained there with an NVIDIA
H200, `--device cuda`, and torch 2.11. DroQ, which makes 20 updates a step, has 27 episodes on the Walker, as its curve is flat
by then; most of them ran, compiled, on 16 cores with torch 2.11. Two seeds of TD3 on Spinning-v0 turn one way badly after the
paper's 15 episodes; after 30 all turn both ways.

Success on Walker-v0 has been to trot since 26 November 2026. Studies of before, such as `agents`, still count an episode
without a fall: 100 % for random actions, which [results](results.md) has at 0 %.

In `agents`, one cell is below the paper's: TD3 on Spinning-v0. One of the five seeds came to spin one way only, whatever the
goal, and another to stand still at one of the two goals; its actor explores by small noise, and 750 steps are few for that.

In `sim-to-robot`, training with randomised physics (Walker-v1) walks fastest on robots that it has not seen. Outside of the
ranges it was trained in, no policy fails; a link of 100 ms costs each a third of its speed, which five episodes there do not
bring back.
"""  # noqa: E501


def robots(result: Result) -> str:
    """SAC on each robot."""
    rows = []
    for env, entry in result["environments"].items():
        summary, paper, steps = entry["summary"], entry["paper"] or {}, entry["seeds"][0]["steps"]
        paper_return = paper.get(result["agent"])
        metrics = summary["metrics"]
        walks, is_enough = env.startswith("Walker"), len(entry["seeds"]) >= FEWEST_SEEDS
        note = f"walks {metrics['forward_speed_m_s']:.3f} m/s" if walks else ""
        if summary.get("success_rate") is not None and not walks:
            low, high = summary["success_interval"]
            note = f"success {percent(summary['success_rate'])}" + (
                f" [{100 * low:.0f}, {100 * high:.0f}]" if is_enough else ""
            )
            if "sac_success_rate" in paper:
                note += f" (paper: {percent(paper['sac_success_rate'])})"
            if "on_line_share" in metrics:
                note += f"; on the line for {100 * metrics['on_line_share']:.1f} % of the time"
            if "final_error_mm" in metrics:
                note += (
                    f"; final error {metrics['final_error_mm']:.0f} mm and "
                    f"{metrics['final_error_deg']:.1f} degrees"
                )
        rows.append(
            [
                f"`{env}`",
                str(len(entry["seeds"])),
                f"{entry['episodes']} ({steps} steps)",
                within(summary["return_mean"], summary["return_interval"], len(entry["seeds"])),
                "" if paper_return is None else f"{paper_return[0]:.4g} ± {paper_return[1]:.3g}",
                note,
                f"{summary['training_cpu_s_median']:.0f} s",
            ]
        )
    head = [
        "environment",
        "seeds",
        "episodes",
        "return",
        "SAC in the paper",
        "success and metrics",
        "CPU time of training",
    ]
    return table(head, rows)


def baselines(result: Result) -> str:
    """Random actions and hand-written controllers."""
    rows = []
    for env, entry in result["environments"].items():
        cells = []
        for policy in ("random", "scripted"):
            success = entry[policy].get("success_rate")
            cell = within(entry[policy]["return_mean"], entry[policy]["return_interval"])
            cells.append(cell if success is None else f"{cell}, {percent(success)}")
        paper = entry["paper"] or {}
        paper_cell = "" if "random" not in paper else f"{paper['random'][0]:.4g}"
        if "random_success" in paper:
            paper_cell += f", {percent(paper['random_success'])}"
        rows.append([f"`{env}`", *cells, paper_cell, entry.get("why_they_differ", "")])
    return table(
        ["environment", "random", "hand-written", "random in the paper", "why they differ"], rows
    )


def learning(result: Result) -> str:
    """Return and success over robot steps in the simulations."""
    rows = []
    for env, agents in result["environments"].items():
        for agent, entry in agents.items():
            rows += [
                [
                    f"`{env}`",
                    agent,
                    str(len(entry["seeds"])),
                    f"{mark['mark']}",
                    within(mark["return_mean"], mark["return_interval"], len(entry["seeds"])),
                    percent(mark["success_mean"]) if env.startswith("RoboArm") else "",
                    f"{mark['cpu_s']:.0f} s",
                ]
                for mark in entry["summary"]
                if mark["mark"] in SHOWN_MARKS
            ]
    return table(
        ["environment", "agent", "seeds", "robot steps in total", "return", "success", "CPU time"],
        rows,
    )


def camera(result: Result) -> str:
    """Success of the camera task."""
    rows = []
    for agent, entry in result["agents"].items():
        for mark in entry["summary"]:
            low, high = mark["success_range"]
            success = f"{percent(mark['success_median'])} ({100 * low:.0f} to {100 * high:.0f})"
            rows.append(
                [
                    agent,
                    str(len(entry["seeds"])),
                    str(mark["episodes"]),
                    success,
                    f"{mark['cpu_s_median']:.0f} s",
                ]
            )
    return table(
        ["agent", "seeds", "episodes in total", "success: median (range)", "CPU time"], rows
    )


def transforms_camera(result: Result) -> str:
    """Success of the camera task from the image, and from numbers made of it."""
    rows = []
    for name, rates in result["success"].items():
        rows.append(
            [
                name,
                str(result["episodes"]),
                percent(sum(rates) / len(rates)),
                ", ".join(map(percent, rates)),
            ]
        )
    return table(["SAC reads", "episodes", "success: mean", "of each seed"], rows)


def seeds(result: Result) -> str:
    """Many seeds at once: one process per seed, or one program with stacked networks."""
    at_a_time, rows = result["processes"], []
    one_s = at_a_time["1_at_a_time_s"]
    for name, wall_s in at_a_time.items():
        count = name.split("_")[0]
        rows.append(
            [
                "training",
                f"one process per seed, {count} at a time",
                f"{wall_s:.0f} s",
                f"{one_s / wall_s:.2f}",
            ]
        )
    for name, times in result["updates"].items():
        threads, alone_ms = name.split("_")[0], times["one_after_the_other_ms"]
        rows.append(
            ["updates", f"one after the other, threads: {threads}", f"{alone_ms:.1f} ms", "1"]
        )
        stacked_ms = times["stacked_ms"]
        rows.append(
            [
                "updates",
                f"stacked, threads: {threads}",
                f"{stacked_ms:.1f} ms",
                f"{alone_ms / stacked_ms:.2f}",
            ]
        )
    return table(["what", "how", "wall time", "speedup"], rows)


def ablation(result: Result) -> str:
    """Each default setting set back to the paper's value."""
    rows = []
    for env, agents in result["environments"].items():
        for agent, entry in agents.items():
            for name, variant in entry["variants"].items():
                is_preset = name in ("default", "paper")
                label = (
                    f"`{name}`"
                    if is_preset
                    else " ".join(f"`{key}={value}`" for key, value in variant["setting"].items())
                )
                cell = within(
                    variant["return_mean"], variant["return_interval"], len(variant["returns"])
                )
                success = percent(variant["success_mean"]) if env.startswith("RoboArm") else ""
                seeds, cpu = (
                    str(len(variant["returns"])),
                    f"{variant['cpu_s']:.0f} s" if "cpu_s" in variant else "",
                )
                rows.append(
                    [f"`{env}`", agent, seeds, str(entry["steps"]), label, cell, success, cpu]
                )
    return table(
        [
            "environment",
            "agent",
            "seeds",
            "robot steps",
            "settings",
            "return",
            "success",
            "CPU time",
        ],
        rows,
    )


def literature(result: Result) -> str:
    """Variants of SAC and another algorithm at equal robot steps."""
    environments = result["environments"]
    first, *_ = environments.values()
    rows = []
    for variant, entry in first.items():
        points = [
            point for entries in environments.values() for point in entries[variant]["summary"]
        ]
        cells = [
            within(point["return_mean"], point["return_interval"], len(entry["seeds"]))
            for point in points
        ]
        rows.append(
            [variant, str(len(entry["seeds"])), *cells, f"{entry['summary'][-1]['cpu_s']:.0f} s"]
        )
    marks = [
        f"{env}, {point['mark']} steps"
        for env, entries in environments.items()
        for point in entries[rows[0][0]]["summary"]
    ]
    return table(["variant", "seeds", *marks, "CPU time in WalkerSim-v0"], rows)


def datasets(result: Result) -> str:
    """Datasets of 100 episodes each."""
    rows = []
    for env, entry in result["tasks"].items():
        paper = result["paper"][env]
        rows.append(
            [
                f"`{env}`",
                f"{number(entry['expert']['mean_reward'])} ({number(paper['mean_reward'])})",
                f"{entry['expert']['transitions']} ({paper['expert_transitions']})",
                number(entry["random"]["mean_reward"]),
                f"{entry['random']['transitions']} ({paper['random_transitions']})",
            ]
        )
    head = [
        "task",
        "expert: mean return (paper)",
        "transitions (paper)",
        "random: mean return",
        "transitions (paper)",
    ]
    return table(head, rows)


def offline(result: Result) -> str:
    """Agents trained on datasets alone."""
    agents = sorted({agent for by_agent in result["datasets"].values() for agent in by_agent})
    rows = []
    for data, by_agent in result["datasets"].items():
        cells = []
        for agent in agents:
            cell = by_agent.get(agent)
            if cell is None:
                cells.append("")
                continue
            paper = "" if cell["paper"] is None else f" ({number(cell['paper'])})"
            text = within(cell["return_mean"], cell["interval"], len(cell["seeds"]))
            cells.append(f"{text}{paper}, n={len(cell['seeds'])}")
        rows.append([data, *cells])
    return table(["dataset", *(f"{agent} (paper)" for agent in agents)], rows)


def teachers(result: Result) -> str:
    """SAC with a gait as teacher: returns in shares of the gait's."""
    names = {"demonstrations": "`--demonstrations`", "base": "`--base`", "alone": "no teacher"}
    rows = []
    for way, name in names.items():
        runs = [run for run in result["runs"] if run["way"] == way]
        if not runs:
            continue
        shares = [[value / run["gait"] for value in run["returns"]] for run in runs]
        places = (0, 2, 5, len(shares[0]) - 1)
        at = [
            f"{statistics.median(seed[min(place, len(seed) - 1)] for seed in shares):.2f}"
            for place in places
        ]
        explored = statistics.median(
            value / run["gait"] for run in runs for value in run["explored"]
        )
        falls = sum(run["falls"] for run in runs)
        rows.append(
            [
                name,
                str(len(runs)),
                *at,
                f"{min(map(min, shares)):.2f}",
                f"{explored:.2f}",
                str(falls),
            ]
        )
    head = [
        "",
        "seeds",
        "at once",
        "after 200 steps",
        "500",
        "1,000",
        "the worst of all",
        "while it explores",
        "falls",
    ]
    return f"Returns in shares of the gait's, medians:\n\n{table(head, rows)}"


def worlds(result: Result) -> str:
    """What each way makes of other worlds, and the time of a step."""
    names = {
        "gait": "gait",
        "sac": "SAC",
        "retained": "SAC, its data retained",
        "steered": "SAC, steered",
        "conditioned": "SAC, told the physics",
        "fitted": "gait, in a fitted twin",
    }
    measured = {**result["worlds"], **result["drawn"]}
    ways = [way for way in names if any(_adapted(_part(row, way)) for row in measured.values())]
    rows = [
        [name, number(row["best"]), *(_adapted(_part(row, way)) for way in ways)]
        for name, row in measured.items()
    ]
    sums = [
        f"{part['lost']:.1f} lost, {part['regained']:.1f} regained" if part else ""
        for part in map(result["ways"].get, ways)
    ]
    rows.insert(len(result["worlds"]), ["these in all", "", *sums])
    seeds = {
        way: max(len(_part(row, way).get("before", ())) for row in measured.values())
        for way in ways
    }
    heads = [f"{names[way]}, {seeds[way]} seeds" for way in ways]
    found = table(["world", "best of 400 trials there", *heads], rows)
    found = (
        "Returns before and after 60 s there, and the gain with its standard error, over the "
        f"seeds:\n\n{found}"
    )
    if not result["steps"]:
        return found
    times = list(dict.fromkeys(row["step_ms"] for row in result["steps"]))
    speeds = {
        (row["link"], row["step_ms"]): f"{1000 * row['speed_m_s']:.0f}" for row in result["steps"]
    }
    links = dict.fromkeys(row["link"] for row in result["steps"])
    steps = table(
        ["link", *(f"{ms} ms" for ms in times)],
        [[link, *(speeds[link, ms] for ms in times)] for link in links],
    )
    return (
        f"{found}\n"
        "Speed in mm/s of a gait by the time of a step, `--option step_ms=...`, over each link:\n"
        f"\n{steps}"
    )


def _part(row: Result, way: str) -> Result:
    """The results of a way in a world; those of the gait are in the row itself."""
    part: Result = row if way == "gait" else row.get(way, {})
    return part


def _adapted(part: Result) -> str:
    """The mean returns before and after, and the gain; empty where nothing was measured."""
    if "gain" not in part:
        return ""
    before, after = (number(statistics.fmean(part[when])) for when in ("before", "after"))
    return f"{before} → {after} ({part['gain']:+.1f} ± {part['standard_error']:.1f})"


def step_times(result: Result) -> str:
    """Gaits by the time of a step, streamed or not, and SAC after five minutes."""
    times, rows = list(dict.fromkeys(row["step_ms"] for row in result["gaits"])), []
    for streaming, way in ((False, "with an exchange for each"), (True, "streamed")):
        found = [row for row in result["gaits"] if row["streaming"] is streaming]
        rows.append(
            [way, *(f"{1000 * row['speed_m_s']:.0f} ({row['really_ms']:.0f})" for row in found)]
        )
    gaits = table(["steps", *(f"{ms} ms" for ms in times)], rows)
    learned = []
    for marks in zip(*(run["marks"] for run in result["sac"]), strict=True):
        walked_s, whole_s, speeds = (
            [mark[key] for mark in marks] for key in ("walked_s", "with_resets_s", "speed_m_s")
        )
        spread = (
            f"{1000 * statistics.fmean(speeds):.0f} ({1000 * min(speeds):.0f} to "
            f"{1000 * max(speeds):.0f})"
        )
        times_s = (f"{statistics.fmean(each):.0f} s" for each in (walked_s, whole_s))
        learned.append([str(marks[0]["steps"]), *times_s, str(len(marks)), spread])
    after = table(
        ["robot steps", "walked for", "with resets", "seeds", "mm/s: mean (range)"], learned
    )
    told = (
        "SAC from nothing in `Walker-v2`: streamed steps of 100 ms, heading and last commands "
        "observed"
    )
    return f"Gaits, mm/s (and ms that a step really takes):\n\n{gaits}\n{told}:\n\n{after}"


def updates(result: Result) -> str:
    """CPU milliseconds per update."""
    rows = []
    for agent, entry in result["agents"].items():
        others = [
            f"{entry[peer]['cpu_ms']:.2f} ({entry[peer]['cpu_times_ours']:.2f} x)"
            if peer in entry
            else ""
            for peer in ("ours_compiled", "torchrl_tuned", "torchrl", "sb3", "sbx")
        ]
        rows.append([agent, f"{entry['ours']['cpu_ms']:.2f}", *others])
    names = ["ours, `--compile`", "TorchRL, tuned", "TorchRL", "Stable-Baselines3", "SBX"]
    return table(["CPU ms per update", "ours", *names], rows)


def copies(result: Result) -> str:
    """CPU seconds to a goal with many copies."""
    rows = [
        [
            agent,
            str(entry["copies"]),
            f"{entry['goal']:g}",
            f"{entry['reached']} of {len(entry['cpu_s'])}",
            (
                f"{entry['cpu_s_median']:.0f} s [{min(entry['cpu_s']):.0f} to "
                f"{max(entry['cpu_s']):.0f}]"
            ),
        ]
        for agent, entry in result["agents"].items()
    ]
    default = result.get("default", {})
    note = ""
    if default.get("cpu_s"):
        returns = default["returns"]
        cpu_s = default["cpu_s"]
        taken = f"{statistics.median(cpu_s):.0f} s of CPU time, {max(cpu_s):.0f} s at most"
        reached = f"{statistics.median(returns):.1f} [{min(returns):.1f} to {max(returns):.1f}]"
        seeds = f"{len(returns)} seeds"
        note = f"\nPPO's run of default length, {seeds}: {taken}; a return of {reached}.\n"
    head = ["agent", "copies", "goal", "seeds that reach it", "CPU time, median [min to max]"]
    return table(head, rows) + note


_PACKAGES = {
    "ours": "BricksRL",
    "torchrl": "TorchRL",
    "sb3": "Stable-Baselines3",
    "sbx": "SBX",
}


def race(result: Result) -> str:
    """CPU seconds to a return of -20, start-up included."""
    rows = []
    for name, entry in result["contestants"].items():
        package, _, agent = name.removesuffix("_like_ours").partition("_")
        settings = (
            "default"
            if package == "ours"
            else "as ours"
            if name.endswith("_like_ours")
            else "its own"
        )
        times = [run[-1][1] for run in entry["runs"]]
        rows.append(
            [
                _PACKAGES[package],
                agent,
                settings,
                f"{entry['there']} of {len(times)}",
                f"{entry['steps']:.0f} (every {entry.get('every', 100)})",
                f"{entry['cpu_s']:.1f} s [{min(times):.1f} to {max(times):.1f}]",
            ]
        )
    head = [
        "package",
        "agent",
        "settings",
        "seeds that reach it",
        "robot steps, median (evaluated)",
        "CPU time, median [min to max]",
    ]
    return table(head, rows)


def other_library(result: Result) -> str:
    """Another library's agent by the page's example."""
    rows = []
    for way, runs in result["runs"].items():
        means = [run["mean"] for run in runs]
        mean = sum(means) / len(means)
        found = f"{number(mean)} [{min(means):.1f} to {max(means):.1f}]"
        rows.append([way, str(len(runs)), found, f"{mean / result['trot']:.2f}"])
    return table(
        [
            "observations",
            "seeds",
            f"return after {result['steps']:,} steps",
            "share of the hand-written trot's",
        ],
        rows,
    )


def cql_updates(result: Result) -> str:
    """CPU milliseconds per CQL update."""
    rows = [
        [name, f"{cpu_ms:.1f}", f"{1e3 / cpu_ms:.1f}"] for name, cpu_ms in result["cpu_ms"].items()
    ]
    return table(["CQL", "CPU ms per update", "updates per CPU second"], rows)


def realtime_learning(result: Result) -> str:
    """A robot that learns while it moves."""
    rows = [
        [
            agent,
            f"{entry['wall_over_motion']:.2f}",
            f"{entry['updates_per_step_reached']:.3g} of {entry['updates_per_step_asked']}",
        ]
        for agent, entry in result["agents"].items()
    ]
    return table(["agent", "wall time over motion time", "updates per step"], rows)


def fleet(result: Result) -> str:
    """One robot and four with one learner, until so many episodes in a row are perfect."""
    rows = []
    for count, times in result["times_as_fast"].items():
        one, four = (result[name]["in_a_row"][count] for name in ("1_robot", "4_robots"))
        cells = [
            within(robots["solved_s_iqm"], robots["solved_s_95"]) if "solved_s_95" in robots else ""
            for robots in (one, four)
        ]
        rows.append([f"{count} in a row", *cells, "" if times is None else f"{times:.1f}"])
    cut = result["cut"]
    lost = (
        cut["frames_of_ended_episodes_missing_in_the_dataset"]
        + cut["frames_in_the_buffer_that_the_dataset_lacks"]
    )
    note = (
        "The link of one robot was cut for 30 s: it left after "
        f"{cut['left_s_after_the_cut'][0]:g} s and was back after "
        f"{cut['back_s_after_the_cut'][0]:g} s; the others made "
        f"{cut['episodes_of_the_others_meanwhile']} episodes meanwhile; "
        f"{lost} frames were lost, {cut['frames_linked_with_another_robots']} were linked with "
        "another robot's.\n"
    )
    head = ["perfect episodes", "one robot, s", "four robots, s", "times as fast"]
    return f"{table(head, rows)}\n{note}"


def arena(result: Result) -> str:
    """Catchers of Tag against both runners."""
    scripts = {
        name: {
            f"against_{runner}": result["scripts"][f"{key}_against_{runner}"]
            for runner in ("flee", "random")
        }
        for name, key in (("the script", "chase"), ("random", "random"))
    }
    rows = []
    for catcher, entry in {**result["agents"], **scripts}.items():
        cells = []
        for outcome in (entry["against_flee"], entry["against_random"]):
            ends = (
                f" [{', '.join(f'{100 * end:.0f}' for end in outcome['rate_95'])}]"
                if "rate_95" in outcome
                else ""
            )
            cells.append(f"{percent(outcome['rate'])}{ends}, {outcome['steps_mean']:g} steps")
        cpu_s = (
            f"{statistics.median(entry['training_cpu_s']):.0f} s"
            if "training_cpu_s" in entry
            else ""
        )
        rows.append([catcher, str(entry.get("seeds", "")), cpu_s, *cells])
    head = [
        "catcher",
        "seeds",
        "CPU time of training",
        "wins against the script",
        "wins against a random runner",
    ]
    note = (
        "The catcher is alone in its group: MAPPO, whose critic sees the whole group, is the "
        "same as IPPO here.\n"
    )
    return f"{table(head, rows)}\n{note}"


def telling(result: Result) -> str:
    """Teams that hear one another and teams that are deaf."""
    kinds = {
        "hearing": "trained and played hearing",
        "hearing_made_deaf": "the same teams, played deaf",
        "deaf": "trained and played deaf",
    }
    rows = []
    for agent, entry in result["agents"].items():
        for kind, words in kinds.items():
            rows.append([agent, words, *_successes(entry[kind])])
    scripted = {
        "follow": ("the script", "hearing"),
        "follow_deaf": ("the script", "deaf"),
        "random": ("random actions", "hearing"),
    }
    for name, (script, how) in scripted.items():
        rows.append([script, how, *_successes(result["scripts"][name])])
    head = ["team", "", "through the gate", "of each seed", "steps"]
    cpu_s = [time for entry in result["agents"].values() for time in entry["training_cpu_s"]]
    note = (
        f"{result['frames']:,} steps of training in the simulation, {statistics.median(cpu_s):.0f} "
        "s of CPU (median). The gate is a quarter of the places where it can be.\n"
    )
    return f"{table(head, rows)}\n{note}"


def _successes(outcome: Result) -> list[str]:
    """Share of successes with its interval, successes of each seed, and mean steps."""
    share = percent(outcome["rate"])
    if "rate_95" in outcome:
        ends = ", ".join(f"{100 * end:.0f}" for end in outcome["rate_95"])
        share = f"{share} [{ends}]"
    count = outcome["episodes"] // len(outcome["successes"])
    of_seeds = ", ".join(map(str, outcome["successes"]))
    return [share, f"{of_seeds} of {count}", f"{outcome['steps_mean']:g}"]


def realtime_factor(result: Result) -> str:
    """Virtual robots on one core, and beside another commit if they were compared."""
    before = result.get("before")
    rows = [
        [
            f"`{env}`",
            f"{entry['realtime_factor']:.0f}",
            f"{entry['steps_per_cpu_s']:.0f}",
            f"{entry['mj_step_factor']:.0f}",
            f"{entry['ratio']:.2f}",
            *([f"{entry['times_before']:.2f}"] if before else []),
        ]
        for env, entry in result["environments"].items()
    ]
    head = [
        "environment",
        "times real time",
        "steps per CPU second",
        "`mj_step` alone, times real time",
        "total over `mj_step`",
    ]
    return table([*head, *([f"times the speed of {before}"] if before else [])], rows)


def simulation_speed(result: Result) -> str:
    """Batched simulations."""
    rows = [
        [f"`{env}`", str(entry["batch_size"]), str(entry["threads"]), f"{entry['steps_per_s']:,}"]
        for env, entries in result["environments"].items()
        for entry in entries
    ]
    return table(["environment", "batch", "threads", "steps per second"], rows)


def link_rates(result: Result) -> str:
    """Exchanges over a simulated radio."""
    rows = [
        [
            interval,
            f"{entry['p50_ms']:.1f} ms",
            f"{entry['p99_ms']:.1f} ms",
            f"{entry['rate_hz']:.1f} Hz",
        ]
        for interval, entry in result["lock_step"].items()
    ]
    return table(["connection interval", "one exchange: median", "p99", "rate"], rows)


def motors(result: Result) -> str:
    """Motors of the twins and of LEGO's sheets."""
    rows = []
    for kind, entry in result["motors"].items():
        twin, sheet, off = entry["twin"], entry["sheet"] or {}, entry["deviation_pct"]
        cells = [
            f"{twin[name]:.3g}" + (f" ({sheet[name]:g}: {off[name]:+.0f} %)" if sheet else "")
            for name in ("free_rpm", "loaded_rpm", "stall_ncm")
        ]
        source = "LEGO's data sheet" if sheet else "Pybricks' measured curve"
        rows.append([kind, cells[0], f"{cells[1]} at {entry['load_ncm']:g} Ncm", cells[2], source])
    return table(
        ["motor at 7.2 V", "free, rpm (sheet)", "loaded, rpm (sheet)", "stall, Ncm (sheet)", "of"],
        rows,
    )


def transforms(result: Result) -> str:
    """What is learned behind transforms."""
    rows = []
    for name, entry in result["transforms"].items():
        apart = within(entry["difference"], entry["interval"]) if "interval" in entry else ""
        rows.append(
            [
                f"`{name}`",
                str(len(entry["returns"])),
                number(statistics.fmean(entry["returns"])),
                apart,
            ]
        )
    text = table(["transform", "seeds", "return", "difference to plain"], rows)
    return text + (
        f"\n`{result['env']}`, returns of the environment itself after {result['steps']} steps of "
        "the robot. With FrameSkip an\n"
        "agent's step is two of the robot, so it made half of the updates.\n"
    )


def resets(result: Result) -> str:
    """Starts at rest, and falls of a trained Walker."""
    rows = [
        [
            f"`{env}`",
            str(entry["starts"]),
            str(entry["restless"]),
            f"{entry['most_deg']:.2f}",
            f"{entry['most_mm']:.2f}",
        ]
        for env, entry in result["environments"].items()
    ]
    text = table(
        ["environment", "starts", "not at rest", "largest turn, degrees", "largest way, mm"], rows
    )
    if walker := result.get("walker"):
        text += (
            f"\nFalls of a trained Walker in {walker['episodes']} evaluation episodes: "
            f"{walker['falls']}.\n"
        )
    return text


def senses(result: Result) -> str:
    """Sensors, nominal and drawn."""
    rows = [
        [
            f"{row['name']}, {row['unit']}",
            row["published"],
            f"{row['nominal']:.4g}",
            f"{row['low']:.4g} to {row['high']:.4g}",
            f"`{row['parameter']}`: {row['source']}",
        ]
        for row in result["rows"]
    ]
    exchanged = result["exchanged"]
    turned = ", ".join(number(heading_deg) for heading_deg in exchanged["heading_deg"])
    rows.append(
        [
            f"{exchanged['name']}: heading after 4 s, deg",
            exchanged["published"],
            turned,
            "",
            "noise of the gyroscope alone",
        ]
    )
    return table(
        ["reading", "published", "nominal twin", "drawn twins", "parameter and source"], rows
    )


def link_exchanges(result: Result) -> str:
    """Exchanges over each link, measured (expected)."""
    rows = []
    for name, link in result["links"].items():
        expected = link["expected"]
        for row, label in (("exchanges", ""), ("after_pause", " after a pause of 1 s")):
            given = {percent: f" ({value})" for percent, value in expected.get(row, {}).items()}
            times = [
                f"{link[row][percent]}{given.get(percent, '')}"
                for percent in ("p50", "p95", "p99", "p99.9")
            ]
            rows.append(
                [f"{name}{label}", *times, expected["source"] if row == "exchanges" else ""]
            )
    return table(
        ["link; ms, measured (expected)", "p50", "p95", "p99", "p99.9", "source of the expected"],
        rows,
    )


def link_profiles(result: Result) -> str:
    """Returns over each link."""
    links = list(dict.fromkeys(link for found in result["environments"].values() for link in found))
    rows = []
    for row, found in result["environments"].items():
        cells = [found.get(link) for link in links]
        rows.append(
            [
                row,
                *(
                    f"{cell['return_mean']:.4g}{success_of(cell)}" if cell else "-"
                    for cell in cells
                ),
            ]
        )
    return table(["mean return (success)", *links], rows)


def success_of(cell: Result) -> str:
    """Share of successful episodes, in brackets."""
    return f" ({100 * cell['success_rate']:.0f} %)" if "success_rate" in cell else ""


def measured_robots(result: Result) -> str:
    """Errors of the measurement of drawn robots."""
    robots = result["robots"]
    head = ["error", *(f"{row['robot']}, {row['robot_time_s']:.0f} s" for row in robots), "allowed"]
    rows = [
        [name, *(f"{row['errors'][name]:.3g}" for row in robots), f"{limit:g}"]
        for name, limit in result["limits"].items()
    ]
    return f"{table(head, rows)}\n{_LATE}"


_LATE = """\
Over the link `mac` one exchange in 9,000 takes over 150 ms: two sessions in three see none, so their share cannot be told from
two minutes. With the bursts of the virtual link taken as known, the losses seen would give it within a factor of
two in two sessions of three (counted: in none); bursts of a real link are not known, so `twin measure` tells what it has seen.
"""  # noqa: E501


def kit_learning(result: Result) -> str:
    """Tasks on the cart of LEGO's kits, next to a robot with a hub."""
    rows = []
    for env_id, entry in result["environments"].items():
        cart, hub, seeds = entry["cart"], entry["hub"], len(entry["seeds"]["cart"])
        learned = [
            within(each["return_mean"], each["return_interval"], seeds) for each in (cart, hub)
        ]
        pairs = [
            "{} ({})".format(*(show(each[key]) for each in (cart, hub)))
            for key, show in _ON_BOTH.items()
        ]
        shares = number(entry["share_of_return"]), number(entry["share_of_score"])
        rows.append([f"`{env_id}`", f"{seeds} x {entry['episodes']}", *pairs, *learned, *shares])
    head = [
        "task",
        "seeds x episodes",
        "ms a step (with a hub)",
        "by hand (with a hub)",
        "success of SAC (with a hub)",
    ]
    return table([*head, "SAC on the cart", "with a hub", "share", "from random actions on"], rows)


def ev3_learning(result: Result) -> str:
    """Tasks on the EV3 driver over the rates of its link, next to the robots with a SPIKE hub."""
    rows = []
    for env_id, entry in result["environments"].items():
        ev3, hub, runs = entry["ev3"], entry["hub"], entry["seeds"]
        learned = [
            within(each["return_mean"], each["return_interval"], len(runs)) for each in (ev3, hub)
        ]
        success = f"{percent(ev3['success_rate'])} ({percent(hub['success_rate'])})"
        by_exchange = ", ".join(number(run["return_mean"]) for run in runs)
        shares = number(entry["share_of_return"]), number(entry["share_of_score"])
        seeds = f"{len(runs)} x {entry['episodes']}"
        rows.append([f"`{env_id}`", seeds, *learned, success, by_exchange, *shares])
    exchanges = ", ".join(f"{run['exchange_ms']:g}" for run in runs)
    head = [
        "task",
        "seeds x episodes",
        "SAC on the EV3 driver",
        "with a SPIKE hub",
        "success (with a SPIKE hub)",
        f"return of each seed; an exchange takes {exchanges} ms",
        "share",
        "from random actions on",
    ]
    return table(head, rows)


_ON_BOTH: dict[str, Callable[[Any], str]] = {
    "step_ms": str,
    "scripted_return": number,
    "success_rate": percent,
}


def kit_programs(result: Result) -> str:
    """Programs and faults on virtual devices of LEGO's kits."""
    counts = result["programs"]
    failed = {group: sum(name.startswith(group) for name in result["failed"]) for group in counts}
    rows = [
        [
            f"programs of our own that end as they should, of {counts['own']}",
            str(counts["own"] - failed["own"]),
        ],
        [
            f"programs and pieces that LEGO publishes, of {counts['lego']}",
            str(counts["lego"] - failed["lego"]),
        ],
        [f"faults of the link without a hang, of {result['faults']}", str(result["faults"])],
        ["steps that ended as lost in them", str(result["steps_lost"])],
        ["simulated seconds a second, of the cart on its line", f"{result['speed_of_learning']:g}"],
    ]
    return table(["what", "number"], rows)


def gait(result: Result) -> str:
    """Policy search, and policies on the hub."""
    walker, six, trot = result["walker"], result["six_legs"], result["trot"]
    rows = [
        [
            "Walker-v1, hand-written trot",
            "",
            number(trot["return"]),
            f"{1000 * trot['speed_m_s']:.0f}",
            "",
            "",
        ]
    ]
    for name, runs in filter(
        lambda row: row[1], (("Walker-v1, gait", walker), ("six legs, gait", six))
    ):
        returns, speeds, cpu_s = (
            [run[key] for run in runs] for key in ("return", "speed_m_s", "cpu_s")
        )
        ranges = (
            f"{min(returns):.1f} to {max(returns):.1f}",
            f"{1000 * min(speeds):.0f} to {1000 * max(speeds):.0f}",
        )
        rows.append(
            [
                name,
                str(len(runs)),
                *ranges,
                str(sum(run["falls"] for run in runs)),
                f"{max(cpu_s):.1f}",
            ]
        )
    searched = table(["", "seeds", "return", "mm/s", "falls", "CPU s, at most"], rows)
    rows = [
        [
            *(
                f"`{one['env']}`",
                f"{one['agent']}: {one['kind']}",
                f"{one['policy_return']:.1f}",
                f"{one['hub_return']:.1f}",
            ),
            *(f"{one['program_bytes']:,}", f"{one['heap_bytes']:,}", f"{one['computing_ms']} ms"),
        ]
        for one in result["hub"]
    ]
    head = [
        "",
        "policy",
        "its return",
        "on the hub alone",
        "bytes of program",
        "of objects",
        "computes",
    ]
    alone = table(head, rows)
    found = f"After {result['steps']} robot steps:\n\n{searched}"
    return (
        f"{found}\nAs programs without a computer, on the virtual hub:\n\n{alone}"
        if rows
        else found
    )


def drawings(result: Result) -> str:
    """What robots learn that were drawn."""
    rows = []
    for name, found in result["plans"].items():
        learned = found.get("learned", {})
        can = ", ".join(found.get("can", ())) or "nothing"
        why = found.get("refused") or learned.get("refused", "")
        if not (why or learned):
            reasons = [*found["lacks"], *dict.fromkeys(found["cannot"].values())]
            why = "; ".join(reasons)
        cells = [name, can, learned.get("goal", "")]
        if "return" not in learned:
            rows.append([*cells, why, "", "", ""])
            continue
        alone = learned.get("no_program", "")
        if not alone:
            alone = f"{number(learned['alone'])} ({number(learned['over_link'])})"
        success = learned["success_rate"]
        rows.append(
            [
                *cells,
                f"{number(learned['return'])}, {learned['steps']} steps",
                "" if success is None else percent(success),
                alone,
                f"{learned['cpu_s']:.0f} s",
            ]
        )
    head = [
        "plan",
        "it can learn",
        "it learned",
        "return, or why not",
        "success",
        "by itself (over the link)",
        "CPU time",
    ]
    return table(head, rows)


def walkers(result: Result) -> str:
    """Walkers of different legs."""
    rows = []
    for name, found in result["walkers"].items():
        rows.append(
            [
                name.replace("_", " "),
                str(found["parts"]),
                f"{found['mass_g']} g",
                f"{1000 * found['least_m_s']:.0f}",
                f"{1000 * found['mean_m_s']:.0f}",
                number(max(seed.get("tilt_deg", 0.0) for seed in found["seeds"])),
                str(found["falls"]),
            ]
        )
    head = ["walker", "parts", "mass", "slowest seed, mm/s", "mean of 5 seeds, mm/s"]
    head += ["largest tilt, degrees", "falls"]
    return table(head, rows)


SECTIONS: dict[str, tuple[str, Callable[[Result], str]]] = {
    "robots": ("SAC on each robot, with the paper's number of episodes", robots),
    "kit_learning": ("SAC on the cart of LEGO's kits, through LEGO's package", kit_learning),
    "ev3_learning": ("SAC on the EV3 driver, over the rates of its link", ev3_learning),
    "baselines": ("Random actions and hand-written controllers (return, success)", baselines),
    "learning": ("Learning in the simulations, evaluated without exploration", learning),
    "copies": ("Learning from many copies of WalkerSim-v0 at once, start-up included", copies),
    "race": ("Race to a return of -20 on WalkerSim-v0, start-up included", race),
    "other_library": (
        "Stable-Baselines3's SAC on Walker-v1, by the example of the page on other libraries",
        other_library,
    ),
    "gait": ("Gaits by policy search, and policies on the hub alone", gait),
    "worlds": ("A minute in other worlds, and the time of a step", worlds),
    "step_times": ("Streamed steps: gaits, and SAC after five minutes", step_times),
    "camera_learning": ("The camera task", camera),
    "transforms_camera": (
        "The camera task through 64 numbers of a random convolution",
        transforms_camera,
    ),
    "seeds": ("Five seeds at once: parallel processes or stacked networks", seeds),
    "transforms": ("SAC behind TorchRL's transforms", transforms),
    "ablation": ("Ablation: each default setting set back to the paper's value", ablation),
    "literature": ("What the literature offers, at equal robot steps", literature),
    "datasets": ("Datasets of 100 episodes", datasets),
    "offline": ("Offline learning, with the paper's settings and number of updates", offline),
    "offline_default": ("Offline learning, with the default settings", offline),
    "teachers": ("SAC with a gait as its teacher, on Walker-v1", teachers),
    "updates": ("Cost of an update", updates),
    "cql_updates": ("Cost of a CQL update", cql_updates),
    "realtime_learning": (
        "Learning in parallel with a robot that takes real time",
        realtime_learning,
    ),
    "fleet": ("Four robots with one learner against one, SAC on RunAway-v0 in real time", fleet),
    "arena": ("Tag: catchers trained in the simulation, in the arena", arena),
    "telling": ("A guide that tells a driver over the air where the gate is", telling),
    "realtime_factor": (
        "Speed of the virtual robots, hub program and environment included",
        realtime_factor,
    ),
    "simulation_speed": ("Speed of the batched simulations", simulation_speed),
    "motors": (
        "Motors of the twins, free, under load and stalled, against LEGO's data sheets",
        motors,
    ),
    "resets": ("Starts of the virtual robots after random steps", resets),
    "senses": ("Sensors of the virtual robots, beside what is published", senses),
    "link_exchanges": ("Exchanges over each link of the virtual hub", link_exchanges),
    "link_profiles": ("SAC on each robot over each link of the virtual hub", link_profiles),
    "measure": ("Two minutes with a robot: errors of `twin measure`", measured_robots),
    "link_rates": ("Rate of the link, over a simulated radio", link_rates),
    "drawings": ("Drawings that learn, from the plan alone (one seed)", drawings),
    "walkers": ("Walkers of different legs, after two minutes of robot time", walkers),
    "kit_programs": ("Virtual devices of LEGO's kits, behind LEGO's package", kit_programs),
}

COMMANDS = {
    "offline_default": "offline --preset default",
    "transforms_camera": "transforms --camera --seeds 3 --episodes 100 --camera-episodes 100",
}
"""Benchmarks of sections that have another name."""


def section(name: str, result: Result) -> str:
    """A result with its title and its command."""
    title, render = SECTIONS[name]
    command = f"`python -m benchmarks {COMMANDS.get(name, name)}`{_since(name)}"
    return f"## {title}\n\n{command}\n\n{render(result)}"


def _since(name: str) -> str:
    """When a result was measured, and whether its code has changed since, as `age` has found; ""
    for one that it does not know."""
    path = RESULTS / "age.json"
    ages = json.loads(path.read_text(encoding="utf-8"))["results"] if path.exists() else {}
    if name not in ages:
        return ""
    age = ages[name]
    since = ""
    if age["is_older"]:
        since = "; the code that it depends on has changed since"
    if age["is_unchanged"]:
        since = "; the code has changed since, and the quick form gives the same numbers"
    return f" ({age['day']}{since})"


def page() -> str:
    """All of docs/results.md."""
    paths = {name: RESULTS / f"{name}.json" for name in SECTIONS}
    return "\n".join(
        (
            HEAD,
            *(
                section(name, json.loads(path.read_text(encoding="utf-8")))
                for name, path in paths.items()
                if path.exists()
            ),
        )
    )


def studies() -> str:
    """All of docs/studies.md: the studies that were made."""
    paths = [RESULTS / f"{study.result}.json" for study in STUDIES]
    parts = [
        study_page(json.loads(path.read_text(encoding="utf-8"))) for path in paths if path.exists()
    ]
    return "\n".join(
        (STUDIES_HEAD, *(re.sub("^#", "##", part, flags=re.MULTILINE) for part in parts))
    )


def commands(text: str) -> str:
    """The page of the benchmarks with the current registry."""
    rows = []
    for group, benchmarks in GROUPS.items():
        rows.append([f"**{group}**", "", "", ""])
        for one in benchmarks:
            command = f"`python -m benchmarks {f'{one.name} {one.needs}'.strip()}`"
            rows.append([command, one.title, duration(one.minutes), duration(one.quick_minutes)])
    listed = table(["command", "what it measures", "time on two cores", "with `--quick`"], rows)
    return BLOCK.sub(lambda _: f"\n{listed}\n", text)


def readme(text: str) -> str:
    """The README with the current table of the robots and summary."""
    robots_table = robots(json.loads((RESULTS / "robots.json").read_text(encoding="utf-8")))
    note = f"Measured with `python -m benchmarks robots`{_since('robots')}.\n"
    return BLOCK.sub(lambda _: f"\n{robots_table}\n{note}\n{summary()}\n", text)


def virtual_hub(text: str) -> str:
    """The page of the virtual hub with the current comparison with the firmware."""
    kinds = json.loads((RESULTS / "firmware_programs.json").read_text(encoding="utf-8"))["kinds"]
    rows = [
        [PROGRAMS[kind], str(counts["programs"]), str(counts["same"])]
        for kind, counts in kinds.items()
    ]
    return BLOCK.sub(
        lambda _: f"\n{table(['random programs', 'number', 'print the same'], rows)}\n", text
    )


def architecture(text: str) -> str:
    """The page of the architecture with the walks of today's code."""
    walks = json.loads((RESULTS / "walks.json").read_text(encoding="utf-8"))["walks"]
    rows = [
        [name, str(len(files)), ", ".join(f"`{file}`" for file in files)]
        for name, files in walks.items()
    ]
    return BLOCK.sub(
        lambda _: f"\n{table(['value', 'files', 'in the order of its way'], rows)}\n", text
    )


def paper_page(text: str) -> str:
    """The page of the paper with its claims beside today's results."""
    cells = json.loads((RESULTS / "study_paper.json").read_text(encoding="utf-8"))["cells"]
    return BLOCK.sub(lambda _: f"\n{claims(cells)}\n", text)


def main(session: Session) -> None:
    """Write, or check."""
    session.parser.add_argument("--check", action="store_true")
    args = session.parse()
    pages = {PAGE: page(), STUDIES_PAGE: studies()}
    blocks = {
        README: readme,
        BENCHMARKS_PAGE: commands,
        VIRTUAL_HUB_PAGE: virtual_hub,
        ARCHITECTURE_PAGE: architecture,
    }
    blocks[PAPER_PAGE] = paper_page
    for path, written in blocks.items():
        pages[path] = written(path.read_text(encoding="utf-8"))
    for path, text in pages.items():
        if not args.check:
            path.write_text(text, encoding="utf-8")
        elif not path.exists() or path.read_text(encoding="utf-8") != text:
            raise RunError(
                f"{path.relative_to(ROOT)} does not match the results; run python -m "
                "benchmarks tables"
            )
