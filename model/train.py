"""Train a network: ``python -m model.train CONFIG --data DIR --out DIR [--system NAME]``.

The network and its settings come from the family of the system; the loop is `model.training.loop`.
"""

import argparse
import logging
import sys
from pathlib import Path

import torch

from conventions.names import printable
from model.data.recordings import DataError
from model.storage.cards import BUNDLED_WEIGHTS, CheckpointError, override_setting
from model.systems.registry import families, family_of, representatives, unavailable_family_messages
from model.training.loop import TrainingError, train
from model.training.parallel import joined_processes


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    trained = [name for family in families() for name in family.trainable_networks]
    parser = argparse.ArgumentParser(prog="python -m model.train", description=__doc__)
    parser.add_argument("config", help=f"one of {', '.join(_presets())}")
    parser.add_argument("--data", type=Path, required=True, help="folder in BEAT2's layout")
    parser.add_argument("--out", type=Path, required=True, help="folder for state and weights")
    parser.add_argument(
        "--system", default=representatives("training")[0], help=f"one of {', '.join(trained)}"
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="FIELD=VALUE", dest="settings",
        help="set a field of the config, for example steps=500; can be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--helpers",
        type=Path,
        default=BUNDLED_WEIGHTS,
        metavar="DIR",
        help="folder with the weights of pretrained networks that the training uses",
    )
    parser.add_argument(
        "--start-from",
        type=Path,
        metavar="DIR",
        help="begin with the weights of this folder and a fresh optimizer",
    )
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--no-compile", action="store_true", help="do not compile training steps")
    parser.add_argument(
        "--resume", action="store_true", help="continue from the state saved in --out"
    )
    args = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    torch.set_num_threads(args.threads)
    for sentence in unavailable_family_messages():
        sys.stderr.write(f"{printable(sentence)}\n")
    try:
        family = family_of(args.system)
        config = family.config(args.config, args.system)
        for setting in args.settings:
            config = override_setting(config, setting)
        with joined_processes() as shard:
            train(
                config,
                family.make_task,
                args.data,
                args.out,
                helper_weights=args.helpers,
                resume=args.resume,
                initial_weights=args.start_from,
                shard=shard,
                may_compile=not args.no_compile,
            )
    except (TrainingError, DataError, CheckpointError, ValueError) as error:
        sys.stderr.write(f"{printable(str(error))}\n")
        return 1
    except (FloatingPointError, OSError) as error:
        sentence = printable(str(error))
        sys.stderr.write(f"Training stopped: {sentence} The last saved state is kept.\n")
        return 1
    return 0


def _presets() -> list[str]:
    trained = ((family, name) for family in families() for name in family.trainable_networks)
    presets = (preset for family, name in trained for preset in family.presets(name))
    return list(dict.fromkeys(presets))


if __name__ == "__main__":
    sys.exit(main())
