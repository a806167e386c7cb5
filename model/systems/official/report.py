"""What is found where the authors' checkpoints were named: each is read."""

from collections.abc import Iterator

from model.generation.named_files import FileReport
from model.systems.official.checkpoint import load_network
from model.systems.official.files import PARTS, OfficialFiles
from model.systems.official.speech import official_encoder

_ADVICE = "see docs/official.md"


def reports_of(files: OfficialFiles) -> Iterator[FileReport]:
    """Of each network, and of what hears for them."""
    for part in PARTS:
        name, is_needed = f"official {part}", part in ("motion", "expression")
        try:
            path = files.path(part)
            count = sum(each.numel() for each in load_network(part, path).parameters())
        except Exception as error:  # whatever is wrong with a file is what is told
            yield FileReport(name, error=error, advice=_ADVICE, is_needed=is_needed)
        else:
            detail = f"{path.relative_to(files.folder)}, {count / 1e6:.1f} M parameters"
            yield FileReport(name, detail)
    try:
        official_encoder()
    except Exception as error:  # as above, of what transformers raises
        yield FileReport("official speech", error=error, advice=_ADVICE)
    else:
        yield FileReport("official speech", "WavLM, HuBERT or features are there")
