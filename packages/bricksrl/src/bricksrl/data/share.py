"""Sharing of datasets and policies on the Hugging Face hub.

``HF_ENDPOINT`` selects another server. A download is checked before it is moved to its folder, and
nothing in it is executed: a policy is a safetensors file and two JSON files.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from brickhub.files import FULL, atomic_folder, quoted, writing
from bricksrl.data.dataset import dataset_folder, refuse_target
from bricksrl.data.integrity import check
from bricksrl.data.schema import CODEBASE_VERSION
from bricksrl.data.summary import Summary, summarise
from bricksrl.errors import DataError, installed, message_of
from bricktwin.measure.session import read_log

if TYPE_CHECKING:
    from huggingface_hub import HfApi

CARD = "README.md"
_FILES = ["meta/**", "data/**", "videos/**"]


def push_dataset(
    path: Path,
    repo: str,
    *,
    private: bool = False,
    licence: str = "mit",
) -> str:
    """Upload a dataset to the hub, with a generated card and the version tag that LeRobot requires;
    returns its address. Raises DataError if the dataset is not intact, huggingface_hub is not
    installed, or the hub is out of reach or refuses.

    Args:
        repo: name of the repository, as ``name/dataset``.
        licence: of the data, for the card, by the hub's name for it.
    """
    root = dataset_folder(path)
    faults = check(root)
    if faults:
        raise DataError(
            f"{root} is not sound: {faults[0].detail}; see `bricksrl data check {quoted(root)}`"
        )
    summary = summarise(root)
    card = _card(
        title=f"{summary.env} on {summary.robot or 'no robot'}",
        about="Recorded with BricksRL, in LeRobot's dataset format v3.0.",
        rows=summary.rows(),
        tags=("LeRobot", "BricksRL", "reinforcement-learning"),
        files="data/*/*.parquet",
        licence=licence,
    )
    with _pushed(repo, f"{card}{_about_columns(summary)}", private) as api:
        # Hidden files are locks and remnants of killed writers, which nobody should get.
        api.upload_folder(
            repo_id=repo,
            repo_type="dataset",
            folder_path=str(root),
            allow_patterns=_FILES,
            ignore_patterns="*/.*",
        )
        # LeRobot loads the revision that is named after its format.
        api.create_tag(
            repo,
            tag=CODEBASE_VERSION,
            repo_type="dataset",
            exist_ok=True,
        )
        return f"{api.endpoint}/datasets/{repo}"


def push_log(
    path: Path,
    repo: str,
    *,
    private: bool = False,
    licence: str = "mit",
) -> str:
    """Upload the log of a measured robot, as `bricktwin twin measure` writes it, to the hub as a
    dataset; returns its address. Raises TwinError if it is no such log, DataError as
    `push_dataset`."""
    log = read_log(path)
    rows = [("robot", log.robot), ("answers of the hub", len(log.rows)), *log.about.items()]
    about = (
        "Measured by hand with `bricktwin twin measure`. After the first line, each is an answer "
        "of the hub: phase, its clock, "
        "delay of the exchange, values."
    )
    tags = ("BricksRL", "system-identification")
    card = _card(
        f"Two minutes with a {log.robot}",
        about,
        rows,
        tags,
        "log.jsonl",
        licence,
    )
    with _pushed(repo, card, private) as api:
        api.upload_file(
            path_or_fileobj=path.read_bytes(),
            path_in_repo="log.jsonl",
            repo_id=repo,
            repo_type="dataset",
        )
        return f"{api.endpoint}/datasets/{repo}"


@contextmanager
def _pushed(
    repo: str,
    card: str,
    private: bool,
) -> Iterator[HfApi]:
    """The hub, with a repository of datasets that has the card."""
    with hub_client(repo) as api:
        api.create_repo(
            repo,
            repo_type="dataset",
            private=private,
            exist_ok=True,
        )
        api.upload_file(
            path_or_fileobj=card.encode(),
            path_in_repo=CARD,
            repo_id=repo,
            repo_type="dataset",
        )
        yield api


def pull_dataset(
    repo: str,
    out: Path,
    *,
    revision: str | None = None,
) -> Path:
    """Download a dataset from the hub into the folder ``out``. Raises DataError if ``out`` exists,
    there is no such dataset of BricksRL, it is damaged, or the hub is out of reach.

    Args:
        revision: branch, tag or commit; by default the newest.
    """
    with downloaded(
        repo,
        "dataset",
        out,
        [*_FILES, CARD],
        revision,
    ) as folder:
        # The hub adds files of its own, such as .gitattributes.
        found = [fault.detail for fault in check(folder)]
        faults = [detail for detail in found if "is not a file of a dataset" not in detail]
        if faults:
            raise DataError(
                f"{repo} is not sound: {faults[0].replace(str(folder), repo)}; ask its owner, or "
                "take another revision"
            )
    return out


@contextmanager
def downloaded(
    repo: str,
    repo_type: str,
    out: Path,
    patterns: list[str],
    revision: str | None,
) -> Iterator[Path]:
    """Download a repository into a temporary folder, which is renamed to ``out`` on success and
    removed on an error."""
    refuse_target(out)
    with atomic_folder(out) as folder, writing(out):
        with hub_client(repo) as api:
            api.snapshot_download(
                repo,
                repo_type=repo_type,
                revision=revision,
                local_dir=str(folder),
                allow_patterns=patterns,
                max_workers=2,
            )
        shutil.rmtree(folder / ".cache", ignore_errors=True)
        yield folder


@contextmanager
def hub_client(repo: str) -> Iterator[HfApi]:
    """Client of the hub; its errors inside this context are translated into ours. Raises DataError
    if huggingface_hub is not installed, the hub is out of reach, or it refuses."""
    with installed("huggingface_hub", DataError, '"bricksrl[data]"'):
        from huggingface_hub import HfApi, errors
        from huggingface_hub.utils.tqdm import disable_progress_bars
    disable_progress_bars()
    # The hub's client uses requests before version 1.0 and httpx since, so its error is looked up.
    transport_error: type[Exception] = vars(errors)["HTTPError"]
    api = HfApi(endpoint=os.environ.get("HF_ENDPOINT"))
    try:
        yield api
    except errors.LocalTokenNotFoundError:
        raise DataError(
            "the hub does not know who you are; log in with `hf auth login`, or set HF_TOKEN"
        ) from None
    except errors.HFValidationError:
        raise DataError(f"'{repo}' is not a name on the hub; give one like name/dataset") from None
    except (errors.RepositoryNotFoundError, errors.RevisionNotFoundError):
        raise DataError(
            f"the hub shows no {repo} to you; check its name and revision, or log in with `hf "
            "auth login`"
        ) from None
    except errors.HfHubHTTPError as error:
        if getattr(getattr(error, "response", None), "status_code", None) in (401, 403):
            remedy = "log in with `hf auth login` or set HF_TOKEN, as somebody who may"
            raise DataError(f"the hub does not let you at {repo}; {remedy}") from None
        raise DataError(f"the hub refuses {repo} ({message_of(error)}); try again later") from None
    except (errors.OfflineModeIsEnabled, transport_error, OSError) as error:
        # An error of a file on this computer has nothing to do with the network.
        if isinstance(error, OSError) and (error.errno in FULL or error.filename is not None):
            raise
        raise DataError(
            f"the hub at {api.endpoint} cannot be reached ({message_of(error)}); try again with "
            "a network"
        ) from None


def _card(
    title: str,
    about: str,
    rows: Iterable[tuple[str, object]],
    tags: Sequence[str],
    files: str,
    licence: str,
) -> str:
    """Card of a dataset, as Markdown."""
    listed = "".join(f"- {tag}\n" for tag in tags)
    table = "".join(f"| {name} | {value} |\n" for name, value in rows)
    return f"""---
license: {licence}
task_categories:
- robotics
tags:
{listed}configs:
- config_name: default
  data_files: {files}
---

# {title}

{about}

| | |
|---|---|
{table}"""


def _about_columns(summary: Summary) -> str:
    camera = ""
    if summary.camera:
        camera = f"\nImages of the camera `{summary.camera}` are in `videos`, without loss.\n"
    return f"""
- `observation.state`: {", ".join(summary.observation)}
- `action`, in -1..1: {", ".join(summary.action)}
- `next.observation.state`, `next.reward`, `next.terminated`, `next.truncated`: what followed
- `intervention`: a human chose the action
- `age_s`, `hub_time_s`: age of the observation when the action left, and the hub's clock
{camera}
Units, ranges and the description of the robot are in `meta/bricksrl.json`.

```python
from bricksrl import data

episodes = data.load("folder")
```
"""
