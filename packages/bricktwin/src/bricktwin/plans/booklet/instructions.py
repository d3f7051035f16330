"""Steps of a booklet and their pictures: few parts, apart from their places, in a view that hides
none of them. LDraw units.

A step of the plan is split where it has too many parts for one picture. What is put in place is
drawn outside, on its way, with an arrow; the view is turned, or all that hides a part is left out
of a smaller picture, until a quarter of each part can be seen.
"""

import itertools
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bricktwin.plans.booklet.picture import VIEWS, Shown, Studio, View
from bricktwin.plans.building import Move, Occupancy, links_of, moves_of
from bricktwin.plans.connections import Connection, connections
from bricktwin.plans.geometry import Floats
from bricktwin.plans.part import Site
from bricktwin.plans.plan import Placed, Plan, Step

MAX_KINDS = 4
"""Most kinds of pieces in a step."""
MAX_PIECES = 8
"""Most pieces in a step."""
MIN_VISIBLE = 0.25
"""Smallest share of a part that its picture shows."""
# These limits hold while a view is tried out: its few rays see less exactly than those of the
# picture.
_ENOUGH = 0.45
"""Smallest visible share of all parts for which the view is not turned."""
_HIDDEN = 0.33
"""Visible share below which a part counts as hidden."""
_MIN_GAIN = 0.05
"""How much more of the parts another view must show to be worth turning to."""
_MAX_QUERIES = 40_000
"""Largest number of collision tests for a booklet, which bounds its time. Later steps have no
arrows."""
_TRIAL_ZOOM = 1.3
"""Rays per LDU where a view is tried out."""
_GAP = 28.0
"""Distance between a part on its way and its hole, LDU."""
_MAX_TRIES = 12
"""Number of larger distances that are tried."""
_MAX_ARROWS = 4
"""Most arrows of one move."""

Arrow = tuple[Floats, Floats]
"""Start and end [3]."""


@dataclass(frozen=True)
class Scene:
    """A picture to draw.

    Attributes:
        arrows: from what is put in place to where it belongs.
        bright: parts in full colour.
    """

    shown: tuple[Shown, ...]
    view: View
    arrows: tuple[Arrow, ...]
    bright: frozenset[int]


@dataclass(frozen=True)
class Instruction:
    """A step of a booklet.

    Attributes:
        moves: what is put in place, in this order.
        before: parts that are there before.
        assembly: as in ``Placed.assembly``; empty for the robot itself.
        times: how often the sub-assembly is built.
        is_turned: whether the view differs from that of the step before.
        inset: a picture of the parts that the large one hides.
    """

    moves: tuple[Move, ...]
    before: frozenset[int]
    assembly: tuple[str, ...]
    times: int
    note: str
    scene: Scene
    is_turned: bool = False
    inset: Scene | None = None

    @property
    def items(self) -> list[tuple[int, ...]]:
        """New parts, one each, and the parts of sub-assemblies."""
        return [item for move in self.moves for item in move.items]


def instructions(plan: Plan, studio: Studio) -> Iterator[Instruction]:
    """The steps of a booklet in order. A sub-assembly that is built several times is shown once."""
    author = _Author(plan, studio)
    for step, times in plan.different_steps.items():
        yield from author.instructions(step, times)


def kind_of(
    plan: Plan,
    item: tuple[int, ...],
    depth: int,
) -> tuple[object, ...]:
    """Key of equal items of an assembly at a depth of nesting: parts, or sub-assemblies."""
    parts = [plan.parts[part] for part in item]
    nested = parts[0].assembly[depth:]
    # A sub-assembly's name ends with a colon and the number of the copy, which must not tell equal
    # copies apart.
    name = nested[0].rpartition(":")[0] if nested else parts[0].part.number
    return (name, *(placed.colour for placed in parts))


@dataclass
class _Author:
    """Writes the instructions of a plan's steps, one after the other."""

    plan: Plan
    studio: Studio
    view: View = VIEWS[0]
    occupancy: Occupancy = field(init=False)
    joints: Mapping[int, list[tuple[Connection, Site, int, Site]]] = field(init=False)

    def __post_init__(self) -> None:
        # One Occupancy serves all steps, because it counts the queries of the whole booklet.
        self.occupancy = Occupancy(self.plan.parts, _MAX_QUERIES)
        links = connections(self.plan.parts)
        self.links = links_of(self.plan.parts, links)
        joints: dict[int, list[tuple[Connection, Site, int, Site]]] = defaultdict(list)
        for link in links:
            joints[link.male].append((link, link.male_site, link.female, link.female_site))
            joints[link.female].append((link, link.female_site, link.male, link.male_site))
        self.joints = joints

    def instructions(
        self,
        step: Step,
        times: int,
    ) -> Iterator[Instruction]:
        """The instructions of a step of the plan."""
        after = self.plan.present_parts(step)
        moves, _ = moves_of(
            step,
            after,
            self.occupancy,
            self.links,
        )
        before = after - {part for move in moves for part in move.parts}
        note = step.note
        for few in self._split(moves, len(step.assembly), before):
            # The note of a step is needed only once, so it stands on the first of its pages.
            for instruction in self._shown(
                few,
                frozenset(before),
                step,
                times,
            ):
                turned = instruction.scene.view != self.view
                self.view = instruction.scene.view
                yield replace(instruction, note=note, is_turned=turned)
                note = ""
            before |= {part for move in few for part in move.parts}

    def _split(
        self,
        moves: Sequence[Move],
        depth: int,
        before: set[int],
    ) -> list[list[Move]]:
        """Moves in order, in groups of about the same size, with at most four kinds and eight
        pieces each. Items that are moved together stay together if they are as few."""
        pieces: list[Move] = []
        for move in moves:
            if self._is_few([move], depth):
                pieces.append(move)
            else:
                pieces += [Move((item,), move.outward) for item in move.items]
        # A smaller limit that needs as many steps spreads the pieces evenly: else the last step
        # might hold a single piece.
        fullest = self._filled(
            pieces,
            depth,
            MAX_PIECES,
            before,
        )
        for most in range(1, MAX_PIECES):
            split = self._filled(pieces, depth, most, before)
            if len(split) == len(fullest):
                return split
        return fullest

    def _filled(
        self,
        moves: Sequence[Move],
        depth: int,
        most: int,
        before: set[int],
    ) -> list[list[Move]]:
        """Moves in order, in groups of at most ``most`` pieces, unless a single move has more. A
        move that only a later one holds comes in the group of that one."""
        split: list[list[Move]] = []
        for move in moves:
            if split:
                joined = [*split[-1], move]
                count = sum(len(each.items) for each in joined)
                if self._is_few(joined, depth) and count <= most:
                    split[-1].append(move)
                    continue
            few = [move]
            # A piece that nothing holds yet is shown together with the piece that will hold it.
            while split and len(split[-1]) > 1 and self._is_few([split[-1][-1], *few], depth):
                last = split[-1][-1]
                if not self._waits(last, split, before):
                    break
                few.insert(0, split[-1].pop())
            split.append(few)
        return split

    def _waits(
        self,
        last: Move,
        split: Sequence[Sequence[Move]],
        before: set[int],
    ) -> bool:
        """Whether the last of these moves is connected to parts, but to none that are there
        already."""
        there = set(before)
        for move in itertools.chain.from_iterable(split):
            if move is not last:
                there.update(move.parts)
        connected: set[int] = set()
        for part in last.parts:
            connected.update(other for other, _ in self.links.get(part, ()))
        return bool(connected) and not connected & there

    def _is_few(
        self,
        moves: Sequence[Move],
        depth: int,
    ) -> bool:
        items = [item for move in moves for item in move.items]
        kinds = {kind_of(self.plan, item, depth) for item in items}
        return len(items) <= MAX_PIECES and len(kinds) <= MAX_KINDS

    def _shown(
        self,
        moves: Sequence[Move],
        before: frozenset[int],
        step: Step,
        times: int,
    ) -> Iterator[Instruction]:
        """An instruction for some moves, or two if some of their parts cannot be seen."""
        scene, hidden = self._best_scene(moves, before)
        # With fewer moves at once one part hides less of another, so the step is shown in two
        # halves.
        if hidden and len(moves) > 1:
            half = len(moves) // 2
            yield from self._shown(
                moves[:half],
                before,
                step,
                times,
            )
            placed = before | {part for move in moves[:half] for part in move.parts}
            yield from self._shown(
                moves[half:],
                frozenset(placed),
                step,
                times,
            )
        else:
            inset = self._inset(moves, before, hidden) if hidden else None
            yield Instruction(
                tuple(moves),
                before,
                step.assembly,
                times,
                "",
                scene,
                inset=inset,
            )

    def _best_scene(
        self,
        moves: Sequence[Move],
        before: frozenset[int],
    ) -> tuple[Scene, list[tuple[int, ...]]]:
        """The scene that shows the moves best, and the items that are hidden in it. The view is not
        turned without need."""
        shown, arrows = self._apart(moves, before)
        bright = frozenset(part for move in moves for part in move.parts)
        items = [item for move in moves for item in move.items]
        best: tuple[float, Scene, list[tuple[int, ...]]] | None = None
        # The default view is tried first, then that of the step before; `dict.fromkeys` drops
        # repetitions and keeps this order.
        for view in dict.fromkeys((VIEWS[0], self.view, *VIEWS)):
            picture = self.studio.picture(shown, view, _TRIAL_ZOOM)
            shares = [picture.visible(item) for item in items]
            if best is None or min(shares) > best[0] + _MIN_GAIN:
                shares_of_items = zip(items, shares, strict=True)
                hidden = [item for item, share in shares_of_items if share < _HIDDEN]
                best = (min(shares), Scene(tuple(shown), view, arrows, bright), hidden)
            if best[0] >= _ENOUGH:
                break
        assert best is not None  # noqa: S101
        return best[1:]

    def _inset(
        self,
        moves: Sequence[Move],
        before: frozenset[int],
        hidden: Sequence[tuple[int, ...]],
    ) -> Scene:
        """A scene of the hidden items with the parts that they touch, or of the items alone."""
        parts = {part for item in hidden for part in item}
        touched: set[int] = set()
        for part in parts:
            touched.update(other for other, _ in self.links.get(part, ()) if other in before)
        few = []
        for move in moves:
            items = tuple(item for item in move.items if item in hidden)
            if items:
                few.append(Move(items, move.outward))
        scene, still_hidden = self._best_scene(few, frozenset(touched))
        # If the parts that they touch hide them, they are drawn alone: that is better than not
        # seeing them.
        if still_hidden:
            scene, _ = self._best_scene(few, frozenset())
        return scene

    def _apart(
        self,
        moves: Sequence[Move],
        before: frozenset[int],
    ) -> tuple[list[Shown], tuple[Arrow, ...]]:
        """All parts, those of the moves on their way, and arrows to their places."""
        shifts: dict[int, Floats] = {part: np.zeros(3) for part in before}
        arrows: list[Arrow] = []
        for move in moves:
            shift = np.zeros(3)
            # A part that lies on the table, or whose way is unknown, is drawn in place without an
            # arrow.
            ways = self._ways(move, shifts) if move.outward.any() else []
            if ways:
                on_way = {part: other for part, other in shifts.items() if part not in before}
                shift = move.outward * self._distance_out(move, ways, on_way)
                arrows += [(start + shift, end) for start, end in ways]
            shifts.update(dict.fromkeys(move.parts, shift))
        shown = [Shown(self.plan.parts[part], shift) for part, shift in shifts.items()]
        return shown, tuple(arrows)

    def _distance_out(
        self,
        move: Move,
        ways: Sequence[Arrow],
        on_way: Mapping[int, Floats],
    ) -> float:
        """Distance of a move from its place, LDU: out of all holes, and apart from the parts on
        their way, each shifted [3]."""
        # The arrow must be as long as the deepest of the part's pins and holes, so that the part is
        # drawn outside of them.
        longest = max(float((end - start) @ move.outward) for start, end in ways)
        distance = longest + _GAP
        for _ in range(_MAX_TRIES):
            if self._is_clear(move, move.outward * distance, on_way):
                break
            distance += _GAP
        return distance

    def _ways(
        self,
        move: Move,
        shifts: Mapping[int, Floats],
    ) -> list[Arrow]:
        """Ways of a move: for each of at most four lines, where its pin or hole begins [3] and
        where the one that it belongs to ends [3]."""
        ways: dict[tuple[float, ...], Arrow] = {}
        for part in move.parts:
            for link, site, other, other_site in self.joints.get(part, ()):
                if other not in shifts:
                    continue
                along = float(link.point @ move.outward)
                line = link.point - along * move.outward
                site_end = self._end(part, site, -move.outward)
                other_end = self._end(other, other_site, move.outward) + shifts[other]
                start = line + move.outward * float(site_end @ move.outward)
                end = line + move.outward * float(other_end @ move.outward)
                # Arrows within 4 LDU are one line, of which the outermost end is kept. Adding 0.0
                # turns -0.0 into 0.0, which would otherwise be a second key.
                key = tuple((line / 4).round() + 0.0)
                if key not in ways or (end - ways[key][1]) @ move.outward > 0:
                    ways[key] = (start, end)
        found = [ways[key] for key in sorted(ways)]
        # The first and the last of many arrows show the direction as well as all of them do.
        return found if len(found) <= _MAX_ARROWS else [found[0], found[-1]]

    def _end(
        self,
        part: int,
        site: Site,
        direction: Floats,
    ) -> Floats:
        """The end [3] of a site in a direction."""
        placed = self.plan.parts[part]
        along = placed.rotation @ np.array(site.axis)
        half = np.sign(along @ direction) * site.length / 2
        return np.asarray(placed.point(site.centre) + along * half)

    def _is_clear(
        self,
        move: Move,
        shift: Floats,
        others: Mapping[int, Floats],
    ) -> bool:
        """Whether the boxes of moved parts overlap no boxes of other parts, which are moved too."""
        if not others:
            return True
        where = np.array(list(others.values()))
        low = self.occupancy.low[list(others)] + where
        high = self.occupancy.high[list(others)] + where
        for part in move.parts:
            starts_before = self.occupancy.low[part] + shift < high  # [others, 3]
            ends_after = low < self.occupancy.high[part] + shift
            overlaps = (starts_before & ends_after).all(axis=1)
            if overlaps.any():
                return False
        return True


def placed_items(
    plan: Plan, instruction: Instruction
) -> dict[tuple[object, ...], list[list[Placed]]]:
    """The items of a step by kind."""
    found: dict[tuple[object, ...], list[list[Placed]]] = defaultdict(list)
    for item in instruction.items:
        kind = kind_of(plan, item, len(instruction.assembly))
        found[kind].append([plan.parts[part] for part in item])
    return found
