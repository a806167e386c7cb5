"""System that plans first, and follows the plan."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, Shaped
from torch import Tensor

from conventions.joints import JOINT_INDEX
from model.generation.base import WindowSpec
from model.networks.trained import TrainedWeights
from model.plan.plan import GesturePlan
from model.plan.plan_features import HEAD_FACE_TRACKS, NUM_TRACKS, both_hands_rest_weight
from model.sampling.flow import ClassifierFreeGuidance
from model.storage.cards import CheckpointError
from model.systems.face.face import face_first_fields
from model.systems.globaldiff.system import GlobalDiffSystem
from model.systems.planned.config import FAMILY, PLANNER, PlannedNetworkConfig
from model.systems.planned.limb_constraints import HandFootConstraint
from model.systems.planned.network import PlannedNetwork
from model.systems.planned.planner import Planner, load_planner
from model.systems.planned.streaming_planner import StreamingPlanner

MOTION_GUIDANCE = 1.4
"""Guidance scale of plan, speech and speaker together in the motion."""
HEAD_GUIDANCE = 2.4
"""Guidance scale of neck and head, which were .65 times as fast as people's at the common scale.
More noise would drown the effect of speech on them."""
NOISE_SCALE = 0.45
"""Factor of the noise at the start of the flow. With less noise and more of the plan there is as
much motion, and more of it is planned."""
TRUNK_NOISE_SCALE = 0.85
"""Factor of the noise in the spine, which the plan hardly determines. With the hands' factor it
moved half as fast as people's and the same for all speakers."""
TRUNK = ("spine1", "spine2", "spine3")
REST_NOISE_SCALE = 0.1
"""`NOISE_SCALE` while both hands rest: with the common factor arms moved at 15 degrees a second
through silence, in the corpus at 5."""


DRIFT_CORRECTION_S = 20.0
"""Value of `GlobalDiffSystem.drift_correction_s`: in six steps the flow moves a body a centimetre
a second forwards. At 40 s it was .45 m from home after ten minutes."""


@dataclass(frozen=True, kw_only=True)
class PlannedSystem(GlobalDiffSystem):
    """System of a motion network that follows plans, and the planner that draws them."""

    condition_type = GesturePlan
    planner: Planner

    def draw_condition(
        self, waveform: Float[np.ndarray, " N"], num_frames: int, spec: WindowSpec
    ) -> GesturePlan:
        features = torch.from_numpy(self.encoder.encode(waveform, num_frames))
        return self.planner.plan(features, spec)

    def condition_stream(self, spec: WindowSpec) -> StreamingPlanner:
        return StreamingPlanner(self.planner, spec)

    def make_constraint(
        self,
        condition: GesturePlan | None,
        state: Mapping[str, Shaped[Tensor, " ..."]] | None = None,
    ) -> HandFootConstraint:
        return HandFootConstraint(condition, state or {})

    def conditioning(
        self, waveform: Float[np.ndarray, " N"], num_frames: int, spec: WindowSpec
    ) -> Float[Tensor, "T input_dim"]:
        """Encode speech (`System.conditioning`): features, the plan's tracks and gesture types."""
        assert spec.condition is not None
        return self.planner.motion_network_inputs(
            super().conditioning(waveform, num_frames, spec), spec.condition, 0
        )

    def noise(self, spec: WindowSpec) -> Float[Tensor, "B T C"]:
        assert spec.condition is not None
        noise = super().noise(spec)
        whole = spec.index * self.windowing.advance
        first = whole if spec.first_condition_frame is None else spec.first_condition_frame
        rest = torch.from_numpy(
            both_hands_rest_weight(spec.condition, range(first, first + noise.shape[1]))
        ).float()
        share = (NOISE_SCALE + (REST_NOISE_SCALE - NOISE_SCALE) * rest)[:, None]
        return share * noise + (TRUNK_NOISE_SCALE - share) * self._trunk_noise(noise)

    def _trunk_noise(self, noise: Float[Tensor, "B T C"]) -> Float[Tensor, "B T C"]:
        """Return the noise that moves the trunk's joints alone; components move many joints."""
        mix, unmix = self.normaliser.mix, self.normaliser.unmix
        assert mix is not None and unmix is not None  # a system with a prior has them
        channels = [3 * JOINT_INDEX[name] + k for name in TRUNK for k in range(3)]
        return noise @ unmix[:, channels] @ mix[channels]

    def make_guidance(self, spec: WindowSpec) -> ClassifierFreeGuidance:
        """Return the motion's guidance, which is constant: the requested scale is the plan's."""
        space = self.config.rotation_space
        return ClassifierFreeGuidance(
            MOTION_GUIDANCE, self.normaliser, space, head_scale=HEAD_GUIDANCE
        )

    def split_conditioning(
        self, conditioning: Float[Tensor, "T_ctx dim"], has_speech: Bool[Tensor, " copies"]
    ) -> dict[str, Tensor]:
        """Split `conditioning` into speech features, plan tracks and gesture types."""
        features, tracks, kinds = conditioning.split([self.encoder.dim, NUM_TRACKS, 2], dim=1)
        copies = len(has_speech)
        return {
            "speech": features.expand(copies, -1, -1),
            "has_speech": has_speech,
            "tracks": tracks.expand(copies, -1, -1),
            "kinds": kinds.long().expand(copies, -1, -1),
            "has_plan": has_speech,
        }

    def speaker_inputs(
        self, spec: WindowSpec, has_speech: Bool[Tensor, " copies"]
    ) -> Int[Tensor, " copies"]:
        """Return each copy's speaker, hidden with the speech, so that guidance amplifies style."""
        return super().speaker_inputs(spec, has_speech) * has_speech

    def face_tracks(
        self, conditioning: Float[Tensor, "T_ctx dim"]
    ) -> Float[Tensor, "T_ctx tracks"]:
        return conditioning[:, self.encoder.dim :][:, HEAD_FACE_TRACKS].contiguous()


def load(name: str, folder: Path) -> PlannedSystem:
    """Load the system with its planner and expression network."""
    trained, planner = TrainedWeights.read(folder, name), load_planner(folder)
    config = trained.card.config(PlannedNetworkConfig, "network")
    with trained.card.reporting_errors():
        kind_names = trained.tensors["kinds.names"]
    if not torch.equal(kind_names, planner.kinds.to_tensors()["kinds.names"].float()):
        raise CheckpointError(f"{name} and {PLANNER} were trained with different gesture types.")
    fields = face_first_fields(FAMILY, name, trained, config, folder)
    fields["sha256s"] |= planner.sha256s
    return PlannedSystem(
        **fields,
        rotation_frame="local",
        root_format=config.root,
        network=trained.load_into(PlannedNetwork(config, trained.prior(config.seed_frames))),
        drift_correction_s=DRIFT_CORRECTION_S,
        planner=planner,
    )
