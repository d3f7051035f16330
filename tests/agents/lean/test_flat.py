from __future__ import annotations

import pytest
import torch
from torch import nn

from bricksrl.agents.lean import flat
from bricksrl.agents.lean.flat import Flat, Learned, working_type
from bricksrl.errors import DescriptionError


def modules() -> list[nn.Module]:
    torch.manual_seed(0)
    return [nn.Linear(3, 4), nn.Linear(4, 1)]


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_steps_equal_those_of_torchs_adam(dtype: torch.dtype) -> None:
    ours, theirs = modules(), modules()
    learned = Learned(*ours, learning_rate=0.1, adam_beta=0.8, dtype=dtype)
    optimiser = torch.optim.Adam([p for module in theirs for p in module.parameters()], lr=0.1, betas=(0.8, 0.999))
    for _ in range(3):
        for mine, their in zip(ours, theirs, strict=True):
            for p, q in zip(mine.parameters(), mine.parameters(), strict=True):
                assert p is q
            for p, q in zip(mine.parameters(), their.parameters(), strict=True):
                q.grad = torch.randn_like(q).to(dtype).float()
                learned.gradient(p).copy_(q.grad)
        learned.step()
        optimiser.step()
    for mine, their in zip(ours, theirs, strict=True):
        torch.testing.assert_close(dict(mine.named_parameters()), dict(their.named_parameters()))
        for parameter in mine.parameters():
            assert torch.equal(learned.working(parameter), parameter.to(dtype))


def test_what_is_loaded_into_a_module_is_computed_with() -> None:
    one, other = modules(), modules()
    for dtype in (torch.float32, torch.bfloat16):
        held = Learned(*one, learning_rate=0.1, dtype=dtype)
        state = [{name: value + 1.0 for name, value in module.state_dict().items()} for module in other]
        for module, its in zip(one, state, strict=True):
            module.load_state_dict(its)
        held.load_state_dict(held.state_dict())
        assert torch.equal(held.working(one[0].weight), state[0]["weight"].to(dtype))


def test_adams_memory_of_other_networks_is_refused() -> None:
    state = Learned(nn.Linear(3, 3), learning_rate=0.1).state_dict()
    with pytest.raises(ValueError, match="numbers"):
        Learned(nn.Linear(2, 2), learning_rate=0.1).load_state_dict(state)


def test_following_goes_a_share_of_the_way() -> None:
    one, other = Flat(nn.Linear(3, 2)), Flat(nn.Linear(3, 2), dtype=torch.bfloat16)
    before = other.values.clone()
    other.follow(one, 0.25)
    torch.testing.assert_close(other.values, 0.75 * before + 0.25 * one.values)


def test_bfloat16_is_refused_where_the_processor_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    assert working_type("float32") is torch.float32
    monkeypatch.setattr(flat.torch.cpu, "get_capabilities", lambda: {"avx2": True, "avx512_bf16": False})
    with pytest.raises(DescriptionError, match="no arithmetic in bfloat16.*take precision float32"):
        working_type("bfloat16")
    for name in ("avx512_bf16", "amx_bf16", "bf16"):
        monkeypatch.setattr(flat.torch.cpu, "get_capabilities", lambda name=name: {name: True})
        assert working_type("bfloat16") is torch.bfloat16
