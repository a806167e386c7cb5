"""Training of the two branches: by noise, or by the teacher that was trained so."""

from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import functional as F

from model.data.prepared import Batch, PreparedData
from model.motion.kinematics import open_body_skeleton
from model.motion.packing import Normaliser, decode
from model.sampling.flow import SpeechGuide, interpolate, time_weight
from model.storage.checkpoint import load_into, load_weights
from model.systems.asynfusion.config import DDIM, AsynFusionConfig, LossConfig
from model.systems.asynfusion.network import BRANCHES, GESTURE, DualBranchNetwork, Pair, both
from model.systems.asynfusion.sampling import NUM_STEPS, flow_times, noise_of
from model.systems.asynfusion.streams import Streams, face_tensors, fit_streams, read_streams
from model.training import losses
from model.training.parallel import WHOLE, Draws, Shard
from model.training.rate import can_compile
from model.training.targets import Targets, heard, prepare_targets
from model.training.task import DescentTask, StepFunction, StepLoss, TaskSetup, check_speakers

NAMES = "expression", "gesture"
HUBER_C = 0.03


def make_task(config: AsynFusionConfig, data: PreparedData, setup: TaskSetup) -> DescentTask:
    """The task of ``config.system``. A student begins as its teacher, `DDIM` among the helpers.

    Raises:
        CheckpointError: if weights are missing, damaged or of another shape.
        DataError: if a speaker's number does not fit the network's table.
    """
    shape, device = config.network, setup.shard.device
    check_speakers(data, shape.num_speakers)
    torch.manual_seed(config.random_seed)
    given = setup.given()
    targets = prepare_targets(data, "axis-angle", "place", open_body_skeleton())
    teacher = None
    if config.aim == "teacher":
        taught, _ = load_weights(setup.helpers, DDIM)
        streams = read_streams(taught, shape.seed_frames)
        teacher = make_network(config, streams, consistent=False)
        load_into(teacher, taught, "network.", DDIM)
        teacher.to(device).eval().requires_grad_(False)
    elif given is not None:
        streams = read_streams(given.tensors, shape.seed_frames)
    else:
        streams = fit_streams(shape, data, targets)
    network = make_network(config, streams, consistent=teacher is not None)
    if given is not None or teacher is None:
        setup.put_weights_into(network, given)
    else:
        network.load_state_dict(teacher.state_dict())
    face, body = streams
    normalisers = face.normaliser.to(device), body.normaliser.to(device)
    statistics = face_tensors(face) | {"prior.covariance": body.prior.covariance}
    compiles = setup.may_compile and can_compile()
    if teacher is not None and compiles:
        teacher.compile(dynamic=False)
    return DescentTask(
        config, network, branches_step(config, normalisers, targets, teacher), normalisers[1],
        shape.window_frames, shape.speech_context, setup.shard, compiles, statistics,
    )  # fmt: skip


def make_network(
    config: AsynFusionConfig, streams: Streams, *, consistent: bool
) -> DualBranchNetwork:
    """An untrained network on the priors of its streams."""
    priors = [stream.prior for stream in streams]
    return DualBranchNetwork(config.network, priors, consistent=consistent)


def branches_step(
    config: AsynFusionConfig,
    normalisers: tuple[Normaliser, Normaliser],
    targets: Targets,
    teacher: DualBranchNetwork | None,
) -> StepFunction:
    """The loss of both branches on one batch."""
    seed_frames = config.network.seed_frames
    times = flow_times()

    def step(
        network: nn.Module, batch: Batch, generator: torch.Generator, shard: Shard = WHOLE
    ) -> StepLoss:
        draws = Draws(len(batch.clips), generator, shard)
        with torch.no_grad():
            vectors, recorded = targets.of(batch.rows(shard.mine), rotations=False)
            motion = shard.of(batch.expression), vectors.to(shard.device)
            x_1 = both(lambda n, m: n.normalise(m), normalisers, motion)
            noise = both(lambda x: draws.noise(x.shape[1:]), x_1)
            steps = draw_steps(draws.size, config, generator)
            steps = shard.of(steps[0]), shard.of(steps[1])
            t = both(lambda k: times.to(k.device)[k], steps)
            x_t = both(interpolate, noise, x_1, t)
            conditions = {
                "seed": both(lambda x: x[:, :seed_frames], x_1),
                "has_seed": draws.keep(config.seed_dropout),
                "has_speech": draws.keep(config.speech_dropout),
                "speaker": shard.of(batch.speaker) * draws.keep(config.speaker_dropout),
                "speech": shard.of(heard(config, network, batch, generator)),
            }
        with shard.autocast():
            predicted = network(x_t, t, **conditions)
            if teacher is not None:
                wanted = one_solver_step(
                    config, network, teacher, normalisers[GESTURE], x_t, steps, conditions
                )
        predicted = both(lambda x: x.float(), predicted)
        terms: dict[str, Tensor] = {}
        for which in BRANCHES:
            if config.aim == "noise":
                found = noise_terms(
                    config.loss, normalisers[which], x_t[which], predicted[which], x_1[which],
                    noise[which], t[which],
                )  # fmt: skip
            elif teacher is not None:
                found = {"consistency": pseudo_huber(predicted[which], wanted[which].float())}
            else:  # eq. 7
                found = {"clean": losses.simple_loss(predicted[which], x_1[which])}
            terms |= {f"{NAMES[which]}_{name}": term.mean() for name, term in found.items()}
        if config.loss.feet or config.loss.contact:
            body = normalisers[GESTURE].restore(predicted[GESTURE])
            told = decode(body, targets.space, targets.skeleton, targets.root)
            recorded = recorded.to(shard.device)
            found = foot_terms(config.loss, told.positions, recorded.positions, t[GESTURE])
            terms |= {name: term.mean() for name, term in found.items()}
        return StepLoss.of(terms)

    return step


def draw_steps(
    size: int, config: AsynFusionConfig, generator: torch.Generator
) -> tuple[Int[Tensor, " B"], Int[Tensor, " B"]]:
    """Diffusion steps of expression and gesture: the same, or apart in a share of the samples."""
    # A student needs one step of the solver below it.
    first = NUM_STEPS // config.solver_steps if config.aim == "teacher" else 0
    gesture = torch.randint(first, NUM_STEPS, (size,), generator=generator)
    other = torch.randint(first, NUM_STEPS, (size,), generator=generator)
    is_apart = torch.rand(size, generator=generator) < config.apart
    return torch.where(is_apart, other, gesture), gesture


def noise_terms(
    weights: LossConfig,
    normaliser: Normaliser,
    x_t: Float[Tensor, "B T C"],
    predicted: Float[Tensor, "B T C"],
    x_1: Float[Tensor, "B T C"],
    noise: Float[Tensor, "B T C"],
    t: Float[Tensor, " B"],
) -> dict[str, Float[Tensor, " B"]]:
    """Weighted eqs. 12 to 14: the noise in components, velocity and clean motion in normalised
    channels (axis-angle, face units)."""
    told, wanted = (normaliser.scaled(normaliser.restore(x)) for x in (predicted, x_1))
    huber = F.huber_loss(told, wanted, reduction="none", delta=weights.huber_delta)
    return {
        "noise": weights.noise * losses.simple_loss(noise_of(x_t, predicted, t), noise),
        "velocity": weights.velocity * losses.difference_loss(told, wanted),
        "huber": weights.huber * huber.mean((1, 2)),
    }


def foot_terms(
    weights: LossConfig,
    positions: Float[Tensor, "B T 55 3"],
    recorded: Float[Tensor, "B T 55 3"],
    t: Float[Tensor, " B"],
) -> dict[str, Float[Tensor, " B"]]:
    """Weighted terms on feet in the world, in metres; the nearer to the data, the heavier."""
    feet, wanted = (joints[:, :, losses.FEET] for joints in (positions, recorded))
    by_sample = time_weight(t, weights.time_weight_floor)
    return {
        "feet": weights.feet * by_sample * losses.velocity_loss(feet, wanted),
        "contact": weights.contact * by_sample * losses.contact_loss(positions, recorded),
    }


@torch.no_grad()
def one_solver_step(
    config: AsynFusionConfig,
    network: nn.Module,
    teacher: DualBranchNetwork,
    normaliser: Normaliser,
    x_t: Pair,
    steps: Pair,
    conditions: dict[str, Any],
) -> Pair:
    """What the student says one DDIM step of the guided teacher nearer to the data, which is what
    it should have said here. The student is its own target, without a moving average (Song and
    Dhariwal 2024); next to the data its prior leaves it no choice but x_t.

    Args:
        normaliser: of the gesture.
    """
    times = flow_times().to(steps[0].device)
    t = both(lambda k: times[k], steps)
    clean = both(lambda x: x.float(), teacher(x_t, t, **conditions))
    guide = SpeechGuide(config.teacher_guidance, normaliser, "axis-angle")
    if guide.asks_twice:
        unheard = conditions | {"has_speech": torch.zeros_like(conditions["has_speech"])}
        deaf = teacher(x_t, t, **unheard)[GESTURE].float()
        clean = clean[0], guide.guided(torch.cat([clean[GESTURE], deaf]))
    noise = both(noise_of, x_t, clean, t)
    earlier = both(lambda k: times[k - NUM_STEPS // config.solver_steps], steps)
    return network(both(interpolate, noise, clean, earlier), earlier, **conditions)


def pseudo_huber(
    predicted: Float[Tensor, "B T C"], target: Float[Tensor, "B T C"]
) -> Float[Tensor, " B"]:
    """``sqrt(d^2 + c^2) - c`` of the root mean square difference d of a window: windows that are
    far off count less than squared (Song and Dhariwal 2024)."""
    return (losses.simple_loss(predicted, target) + HUBER_C**2).sqrt() - HUBER_C
