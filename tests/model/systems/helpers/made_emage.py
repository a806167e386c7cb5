"""A file as EMAGE's evaluation has it, of seeded numbers: bones, neighbours and pools are found by
walking over the skeleton.
"""

import torch
from torch import Tensor

from conventions.joints import NUM_JOINTS, PARENTS

Edges = list[tuple[int, int]]
"""Bones, from joint to joint; the pelvis's own leads to a joint that nobody else knows."""
Chains = list[list[int]]


def levels() -> tuple[list[Edges], list[Chains]]:
    """The bones of each level, and which of them are averaged to one behind it."""
    edges: Edges = [(0, NUM_JOINTS), *((PARENTS[j], j) for j in range(1, NUM_JOINTS))]
    bones: list[Edges] = []
    pools: list[Chains] = []
    for _ in range(4):
        bones.append(edges)
        chains = [chain[i:j] for chain in _chains(edges) for i, j in _pairs(len(chain))]
        pools.append(chains)
        edges = [(edges[chain[0]][0], edges[chain[-1]][1]) for chain in chains]
    return bones, pools


def _pairs(length: int) -> list[tuple[int, int]]:
    """Of an odd number the first stays alone."""
    alone = [(0, 1)] if length % 2 else []
    return alone + [(i, i + 2) for i in range(length % 2, length, 2)]


def _chains(edges: Edges) -> Chains:
    """From the pelvis or a fork to the next fork or end, in the order of a walk over the tree."""
    found: Chains = []

    def walk(bone: int, chain: list[int]) -> None:
        chain = [*chain, bone]
        following = [i for i, edge in enumerate(edges) if edge[0] == edges[bone][1]]
        if len(following) != 1:
            found.append(chain)
            chain = []
        for each in following:
            walk(each, chain)

    for bone, edge in enumerate(edges):
        if edge[0] == 0:
            walk(bone, [])
    return found


def distances(edges: Edges) -> list[list[int]]:
    """Steps from bone to bone; bones that share a joint are one apart."""
    told = []
    for start in range(len(edges)):
        steps = {start: 0}
        waiting = [start]
        while waiting:
            here = waiting.pop(0)
            for other, edge in enumerate(edges):
                if other not in steps and set(edge) & set(edges[here]):
                    steps[other] = steps[here] + 1
                    waiting.append(other)
        told.append([steps[other] for other in range(len(edges))])
    return told


def emage_tensors(seed: int) -> dict[str, Tensor]:
    """By the names of the public code."""
    rng = torch.Generator().manual_seed(seed)

    def drawn(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=rng)

    tensors: dict[str, Tensor] = {}
    bones, pools = levels()
    into = 6
    for place, (edges, chains) in enumerate(zip(bones, pools, strict=True)):
        out = 12 if place > 1 else 6
        apart = torch.tensor(distances(edges))
        near = (apart <= 2).float().repeat_interleave(out, 0).repeat_interleave(into, 1)
        name = f"encoder.layers.{place}.0."
        for part, width in (("residual.0.", 4), ("shortcut.", 1)):
            tensors[f"{name}{part}weight"] = drawn(*near.shape, width) / (width * 60) ** 0.5
            tensors[f"{name}{part}bias"] = 0.1 * drawn(len(near))
            tensors[f"{name}{part}mask"] = near[..., None].repeat(1, 1, width)
        tensors[f"{name}residual.1.weight"] = 0.5 + 0.1 * drawn(len(near))
        tensors[f"{name}residual.1.bias"] = 0.1 * drawn(len(near))
        if len(chains) < len(edges):
            tensors[f"{name}common.0.weight"] = _pool(chains, len(edges), out)
        into = out
    tensors["decoder.main.0.model.0.weight"] = drawn(240, 240, 3)
    tensors["fc_mu.bias"] = drawn(240)
    return tensors


def _pool(chains: Chains, bones: int, width: int) -> Tensor:
    weight = torch.zeros(len(chains), width, bones, width)
    for place, chain in enumerate(chains):
        for bone in chain:
            weight[place, :, bone] = torch.eye(width) / len(chain)
    return weight.reshape(len(chains) * width, bones * width)
