"""How well a system tells x_1 of a recorded clip with the right and with wrong speech."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from conventions.joints import JOINT_DEPTH
from model.data.prepared import home_of
from model.generation.base import DEPTH_FLOW_TIME, FLOW_TIMES, Features, Prediction
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion
from model.motion.packing import Normaliser, decode, to_vectors
from model.networks.branch import PriorNetwork
from model.sampling.flow import interpolate
from model.systems.face.face import Face
from model.systems.globaldiff.config import NetworkConfig
from model.systems.globaldiff.network import MotionNetwork


@dataclass(frozen=True)
class Predictor:
    """A motion network and what it is shown, asked for x_1."""

    config: NetworkConfig
    network: MotionNetwork | PriorNetwork
    normaliser: Normaliser
    face: Face

    @torch.inference_mode()
    def predict(
        self, motion: Motion, tracks: Mapping[str, Features], speaker: int, batch_size: int
    ) -> Prediction:
        """The same windows, noise and flow times for every kind of speech."""
        config = self.config
        window = config.window_frames
        starts = range(0, motion.num_frames - window + 1, window)
        vectors = self._vectors(motion)
        x_1 = self.normaliser.normalise(torch.stack([vectors[s : s + window] for s in starts]))
        x_0 = torch.randn(x_1.shape, generator=torch.Generator().manual_seed(0))
        errors: dict[str, float] = {}

        face = self.face
        face_noise = torch.cat([face.noise(0, index) for index in range(len(x_1))])

        def heard(track: Features, context: int) -> Float[Tensor, "windows heard dim"]:
            rows = np.arange(-context, window + context) + np.array(starts)[:, None]
            return torch.from_numpy(track[rows.clip(0, len(track) - 1)])

        def drawn(track: Features) -> Float[Tensor, "windows T E"]:
            speech = heard(track, face.config.speech_context)
            parts = [
                face.draw(speech[rows], speaker, None, face_noise[rows])[0]
                for rows in (slice(k, k + batch_size) for k in range(0, len(x_1), batch_size))
            ]
            return torch.cat(parts)

        faces = {kind: drawn(track) for kind, track in tracks.items()}

        def predictions(kind: str, time: float) -> Float[Tensor, "windows T C"]:
            speech = heard(tracks[kind], config.speech_context)
            parts = []
            for first in range(0, len(x_1), batch_size):
                rows = slice(first, first + batch_size)
                size = len(x_1[rows])
                t = torch.full((size,), time)
                parts.append(
                    self.network(
                        interpolate(x_0[rows], x_1[rows], t),
                        t,
                        speech=speech[rows],
                        expression=faces[kind][rows],
                        seed=torch.zeros(size, config.seed_frames, x_1.shape[-1]),
                        speaker=torch.full((size,), speaker),
                        has_seed=torch.zeros(size, dtype=torch.bool),
                        has_speech=torch.ones(size, dtype=torch.bool),
                    )
                )
            return torch.cat(parts)

        def scaled(x: Tensor) -> Tensor:
            return self.normaliser.scaled(self.normaliser.restore(x))

        wanted = scaled(x_1)
        for kind in tracks:
            found = [scaled(predictions(kind, time)) for time in FLOW_TIMES]
            at_times = [(one - wanted).square().mean() for one in found]
            errors[kind] = float(torch.stack(at_times).mean())
        late = self.normaliser.restore(predictions("right", DEPTH_FLOW_TIME))
        distance = (self._positions(late) - self._positions(self.normaliser.restore(x_1))).norm(
            dim=-1
        )
        by_joint = distance.mean((0, 1)).numpy()
        depth = np.array(JOINT_DEPTH)
        by_depth = [float(by_joint[depth == d].mean()) for d in range(max(JOINT_DEPTH) + 1)]
        return Prediction(errors, by_depth)

    def _vectors(self, motion: Motion) -> Float[Tensor, "T C"]:
        config = self.config
        trans = motion.trans.astype(np.float32)
        if config.root == "place":
            trans = trans - home_of(trans)
        transl = torch.from_numpy(trans)
        poses = torch.from_numpy(motion.poses.astype(np.float32))
        return to_vectors(config.rotation_space, poses[None], transl[None], config.root)[0]

    def _positions(self, vectors: Float[Tensor, "windows T C"]) -> Float[Tensor, "_ T 55 3"]:
        config = self.config
        return decode(vectors, config.rotation_space, open_body_skeleton(), config.root).rooted
