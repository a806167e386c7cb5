"""The vertices of fingertips, which the SMPL-X format fixes by number and every body file keeps."""

TIP_VERTICES: dict[str, int] = {
    "left_thumb": 5361,
    "left_index": 4933,
    "left_middle": 5058,
    "left_ring": 5169,
    "left_pinky": 5286,
    "right_thumb": 8079,
    "right_index": 7669,
    "right_middle": 7794,
    "right_ring": 7905,
    "right_pinky": 8022,
}
