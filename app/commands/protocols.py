"""Command ``protocols``: the rules by which metrics are measured, and what each needs."""

from __future__ import annotations

import json
import sys
from typing import Annotated

from tyro.conf import arg


def protocols(prints_json: Annotated[bool, arg(name="json")] = False) -> None:
    """List the measurement protocols with their rules and the files that each needs.

    Every number in tables and files carries the id of its protocol; numbers with different ids
    cannot be compared.

    Args:
        prints_json: Write the protocols as JSON.
    """
    from model.metrics.protocols.table import HEADINGS, PROTOCOLS, protocol_row

    if prints_json:
        records = [
            dict(zip(HEADINGS, protocol_row(record), strict=True))
            | {"values": record.value_units or {}}
            for record in PROTOCOLS.values()
        ]
        sys.stdout.write(json.dumps(records, indent=1, ensure_ascii=False) + "\n")
        return
    for record in PROTOCOLS.values():
        name, *cells = protocol_row(record)
        lines = (f"  {title}: {cell}" for title, cell in zip(HEADINGS[1:], cells, strict=True))
        sys.stdout.write("\n".join([name, *lines, ""]) + "\n")
