"""Constants that the browser's viewer shares with the videos."""

from dataclasses import asdict

from conventions.joints import FINGERTIP_VERTICES, JOINT_INDEX, JOINT_NAMES
from conventions.views import VIEWS
from renderer.draw.lighting import lighting_shader_source
from renderer.scene import camera, camera_setup, studio
from renderer.scene.camera_setup import CLOSE_UP_VIEWS, drawn_close_up_joints
from renderer.scene.studio import ROUGHNESS, STUDIO
from renderer.video.overlays import HEAT_COLORS, SPEED_COLORS, SPIKE_COLOR, TRAIL_FRAMES


def browser_render_constants() -> dict:
    """Return the shared constants as JSON types: metres, radians, colours 0 to 1."""
    views = {view: camera.view_axes(view).tolist() for view in VIEWS}
    return {
        "lighting": lighting_shader_source(),
        "studio": asdict(STUDIO),
        "roughness": ROUGHNESS,
        "camera": {"yfov": camera.YFOV_RAD, "near": camera.Z_NEAR_M, "margin": camera.MARGIN_NDC},
        "views": views,
        "joints": list(JOINT_NAMES),
        "close_ups": {
            name: [
                {
                    "view": view,
                    "joints": camera_setup.FOLLOWED_CLOSE_UP_JOINTS[view],
                    "drawn": drawn_close_up_joints(view),
                }
                for view in shown
            ]
            for name, shown in CLOSE_UP_VIEWS.items()
        },
        "framing": {
            "below_knees": list(camera_setup.BELOW_KNEES),
            "knee_flesh": camera_setup.KNEE_FLESH_M,
            "fingertip": camera_setup.FINGERTIP_M,
            "follow_beyond": camera_setup.MAX_STATIC_PELVIS_RANGE_M,
            "lead": camera_setup.MAX_LEAD_M,
            "close_lead": camera_setup.CLOSE_UP_LEAD_M,
            "middle": camera_setup.ORBIT_CENTRE_HEIGHT_M,
            "walk_sigma": camera_setup.WALK_SIGMA_FRAMES,
            "face_sigma": camera_setup.CLOSE_UP_SIGMA_FRAMES,
            "hand_sigma": camera_setup.HAND_CAMERA_SIGMA_FRAMES,
        },
        "ground": {
            "half_size": studio.HALF_SIZE_M,
            "texels": studio.RESOLUTION,
            "touching": studio.CONTACT_HEIGHT_M,
            "lost": studio.SHADOW_STRENGTH,
            "blurs": studio.BLURS,
            "most_lost": studio.MAX_SHADOW,
            "glow": studio.POOL_BRIGHTNESS / 255,
            "lightest": studio.LIGHTEST / 255,
            "pool_power": studio.POOL_POWER,
            "fade": studio.FADE,
        },
        "marks": {
            "heat": HEAT_COLORS.tolist(),
            "speed": (SPEED_COLORS / 255).tolist(),
            "spike": [part / 255 for part in SPIKE_COLOR],
            "trail_frames": TRAIL_FRAMES,
            "tips": {
                name: {"joint": JOINT_INDEX[f"{name}3"], "vertex": vertex}
                for name, vertex in FINGERTIP_VERTICES.items()
            },
        },
    }
