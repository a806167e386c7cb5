"""Requests of tests, by the names of their fields."""

from __future__ import annotations

from typing import Any

from app.run.requests.convert import request_from
from app.run.requests.requests import (
    DiagnoseRequest,
    GenerateRequest,
    PlanRequest,
    RenderRequest,
    RotationNoiseRequest,
    SpeechEffectRequest,
    StepSweepRequest,
)


def generate_request(**fields: Any) -> GenerateRequest:
    """Make a request without videos, unless they are asked for."""
    return request_from(GenerateRequest, {"has_video": False, **fields})


def diagnose_request(**fields: Any) -> DiagnoseRequest:
    return request_from(DiagnoseRequest, fields)


def plan_request(**fields: Any) -> PlanRequest:
    return request_from(PlanRequest, fields)


def render_request(**fields: Any) -> RenderRequest:
    return request_from(RenderRequest, fields)


def rotation_noise_request(**fields: Any) -> RotationNoiseRequest:
    return request_from(RotationNoiseRequest, {"has_video": False, **fields})


def speech_effect_request(**fields: Any) -> SpeechEffectRequest:
    return request_from(SpeechEffectRequest, fields)


def step_sweep_request(**fields: Any) -> StepSweepRequest:
    return request_from(StepSweepRequest, fields)
