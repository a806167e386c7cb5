"""A motion as bodies are posed by it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from renderer.body.body import BodyMotion


def body_motion(motion) -> BodyMotion:
    """A `model.motion.motion.Motion` for the renderer, which does not know the model's types."""
    from renderer.body.body import BodyMotion

    return BodyMotion(
        poses=motion.poses,
        trans=motion.trans,
        expressions=motion.expressions,
        expression_basis=motion.expression_basis,
        betas=motion.betas,
    )
