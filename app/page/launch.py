"""Start of the page: configuration, services and server; models are loaded in the background."""

from __future__ import annotations

import atexit
import errno
import logging
import os
import shutil
import signal
import socket
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

from app import text
from app.config import (
    EXAMPLES,
    LOCAL_PROXIES,
    AppConfig,
    disable_http_proxies,
    use_matplotlib_file_backend,
)
from app.errors import RunError, message_for_user
from app.flags import export_family_files, family_files_annotation, parse_command
from app.page import gradio_changes
from model.systems.registry import families, unavailable_family_messages

if TYPE_CHECKING:
    from gradio import Blocks

    from app.page.tabs.runner import Services
    from app.page.worker import Worker

PORT_TAKEN = (
    "Port {port} of {host} is already in use, perhaps by another instance of this page. Choose "
    "another port with --port."
)
log = logging.getLogger(__name__)
_is_ending = threading.Event()
WARM_UP_DELAY_S = 6.0
"""Time (s) for which the warm-up leaves both cores to a browser that opened at once."""

_ENDING = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
CHECK_BYTES, CHECK_S = 2 * 10**9, 60.0
"""Memory (bytes) and time (s) for the check of an upload, or for the conversion of a motion."""
BACKGROUND_TIMEOUT_S = 960.0
"""Longest time (s) without progress of videos rendered in the background."""
END_WITHIN_S = 15.0
"""Time (s) from a signal to the forced exit; leftover files are then removed at the next start."""


def apply_family_files(
    flags: Annotated[AppConfig, arg(name="")], files: Annotated[Any, family_files_annotation()]
) -> AppConfig:
    export_family_files(vars(files))
    return flags


def parse_config(argv: list[str] | None = None) -> AppConfig:
    """Parse flags and environment into a checked configuration; raises RunError."""
    apply_family_files.__doc__ = text.TAGLINE
    return parse_command(apply_family_files, "app.py", sys.argv[1:] if argv is None else argv)()


def launch(config: AppConfig, preloads_models: bool = True) -> Blocks:
    """Serve the page from threads of this process, at ``local_url`` of the result.

    Raises RunError or CheckpointError if the weights cannot be used, OSError if the port is taken.
    """
    check_port(config)
    _set_environment(config)
    gradio_changes.import_gradio()
    from app.page.page import build_app

    services = _make_services(config, preloads_models)
    page = build_app(services)
    gradio_changes.replace_gradio_queue(page, services.jobs, config.max_queue_size)
    _serve(page, config, _make_routes(services))
    # Loading models earlier would delay the start of the page.
    if preloads_models:
        worker = services.worker
        threading.Thread(target=_warm_up, args=(worker,), name="warm-up", daemon=True).start()
    return page


def _set_environment(config: AppConfig) -> None:
    """Make the folder of temporary files, and set what libraries read from the environment."""
    config.temp_folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if config.trusted_proxies:  # uvicorn reads it
        os.environ["FORWARDED_ALLOW_IPS"] = ",".join((*LOCAL_PROXIES, *config.trusted_proxies))
    use_matplotlib_file_backend()
    disable_http_proxies()
    # Gradio reads them when it is imported or launched.
    os.environ["GRADIO_TEMP_DIR"] = str(config.cache_folder)
    os.environ["GRADIO_ANALYTICS_ENABLED"] = "False"
    # Its tables of past events are never read, and it recomputes all of them at every click.
    os.environ["GRADIO_ANALYTICS_MAX_EVENTS"] = "1"
    os.environ["GRADIO_ANALYTICS_CACHE_FREQUENCY"] = str(2**31)


def _make_services(config: AppConfig, preloads_models: bool) -> Services:
    """Make the services of the page, and end them with this process; raises as `launch`."""
    from app.live.sessions import LiveSessions
    from app.page.parts.catalogue import read_catalogue
    from app.page.results.run_view import example_player_value
    from app.page.results.saved_runs import SavedRuns, add_host_run
    from app.page.routes.guard import silence_invalid_websocket_text
    from app.page.routes.media import SharedFolders
    from app.page.tabs.runner import Services
    from app.page.visitors.characters import Characters
    from app.page.visitors.job_folders import Jobs, start_sweeper
    from app.page.visitors.quota import Quota
    from app.page.worker import TaskLimits, Worker

    for sentence in unavailable_family_messages():
        log.warning("%s", sentence)
    for family in families():
        if (reason := family.one_recording_only_reason()) is not None:
            raise RunError(f"The page cannot start: it must accept any speech, but {reason}")
    catalogue = read_catalogue(config.weights, tuple(sorted(EXAMPLES.glob("*.wav"))))
    proxies = (*LOCAL_PROXIES, *config.trusted_proxies)
    quota = Quota(config.max_stored_bytes_per_address, config.result_lifetime_s, proxies)
    gradio_changes.patch_gradio(config.temp_folder, config.min_free_bytes, quota, proxies)
    silence_invalid_websocket_text()
    jobs = Jobs(config.jobs_folder, quota)
    start_sweeper(config.temp_folder, config.result_lifetime_s, jobs.in_use, quota.forget_deleted)
    atexit.register(jobs.cancel_all)

    limits = TaskLimits(config.max_run_memory_bytes, config.max_run_s)
    warm = (config.weights, config.body) if preloads_models else None
    worker = Worker(limits, warm=warm)
    video_worker = Worker(
        replace(limits, no_progress_s=BACKGROUND_TIMEOUT_S), niceness=19, is_reused=False
    )
    upload_worker = Worker(TaskLimits(CHECK_BYTES, CHECK_S, CHECK_S))
    for each in (worker, video_worker, upload_worker):
        atexit.register(each.close)
    media, saved_runs, opened = SharedFolders(), SavedRuns(config.result_lifetime_s), ()
    if config.run_to_open is not None:
        opened = (
            add_host_run(saved_runs, config.run_to_open, config.temp_folder / "opened", media),
        )
    return Services(
        config=config,
        catalogue=catalogue,
        jobs=jobs,
        worker=worker,
        video_worker=video_worker,
        upload_worker=upload_worker,
        saved_runs=saved_runs,
        live=LiveSessions(config.weights),
        characters=Characters(config.private_folder),
        media=media,
        example_player_value=example_player_value(media) if preloads_models else None,
        opened_run_tokens=opened,
    )


def _make_routes(services: Services) -> list[Any]:
    """Return the routes of the page besides those of Gradio."""
    from app.page.html_export import write_standalone_html
    from app.page.results.saved_runs import download_route
    from app.page.routes.live_route import live_routes
    from app.page.routes.media import OnDemandFiles, media_routes, researcher_route
    from app.page.visitors.visitors import leaving_route, visitor_route
    from app.run.output.run_folder import zip_run_task

    exports = OnDemandFiles(
        services.config.temp_folder, services.upload_worker.do, services.jobs.quota
    )
    return [
        download_route(services.saved_runs, exports, ".zip", zip_run_task),
        download_route(services.saved_runs, exports, ".html", write_standalone_html, "/page"),
        *media_routes(
            services.media, exports, services.characters, services.jobs.quota, services.config.body
        ),
        researcher_route(services.private_files),
        visitor_route(),
        leaving_route(services.jobs),
        *live_routes(services.live),
    ]


def _serve(page: Blocks, config: AppConfig, routes: Sequence[Any]) -> None:
    """Serve the page with Gradio's and the given routes; raises OSError as `launch`."""
    from fastapi.exceptions import RequestValidationError

    from app.page.routes.guard import HostNames, guard_lifespan, refuse_wrong_body
    from app.page.theme import CSS, head_style, make_theme

    page.launch(
        server_name=config.host,
        server_port=config.port or None,  # 0: any free one
        root_path=config.root_path.rstrip("/"),
        share=False,
        prevent_thread_lock=True,
        show_error=True,
        max_file_size=config.max_upload_size,
        allowed_paths=[str(EXAMPLES)],
        blocked_paths=[
            str(path)
            for path in (
                config.weights,
                config.body,
                config.private_folder,
                *(path for family in families() for path in family.non_redistributable_paths()),
            )
            if path
        ],
        run_history=False,
        ssr_mode=False,
        pwa=False,
        mcp_server=False,
        strict_cors=True,
        enable_monitoring=False,
        state_session_capacity=64,
        footer_links=[],
        theme=make_theme(),
        css_paths=[CSS],
        head=head_style(),
        quiet=True,
        # It would send a request to the page, and give up after 3 s on a busy machine.
        _frontend=False,
        # They come before Gradio's own routes, and exist from the first request on.
        app_kwargs={
            "routes": [*routes],
            "exception_handlers": {
                RequestValidationError: refuse_wrong_body,
                **dict.fromkeys(
                    (KeyError, TypeError, ValueError), gradio_changes.answer_wrong_call
                ),
            },
            "lifespan": guard_lifespan(
                HostNames(config.host, config.host_names),
                config.frame_ancestors,
                has_proxy=bool(config.trusted_proxies),
            ),
        },
        auth=list(config.accounts) or None,
    )


def main(argv: list[str] | None = None) -> None:
    logging.basicConfig(format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    try:
        config = claim_temp_folder(parse_config(argv))
        page = launch(config)
    except Exception as error:
        sentence = str(error) if isinstance(error, OSError) else message_for_user(error)
        if sentence is None:
            raise
        sys.exit(f"app.py: {sentence}")
    sys.stderr.write(f"The page is open at {page.local_url}\n")
    page.block_thread()


def check_port(config: AppConfig) -> None:
    """Check that the port is free, before anything else is done; raises OSError."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((config.host, config.port))
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                message = PORT_TAKEN.format(host=config.host, port=config.port)
                raise OSError(message) from error


def claim_temp_folder(config: AppConfig) -> AppConfig:
    """Claim a temporary folder, set TMPDIR and signal handlers; return the new configuration."""
    from app.page.visitors.job_folders import make_process_folder

    temp = make_process_folder(config.temp_folder)
    scratch = temp / "scratch"
    scratch.mkdir(mode=0o700)
    os.environ["TMPDIR"] = str(scratch)  # for temporary files of libraries and child processes
    atexit.register(_remove, temp)
    for number in _ENDING:
        if signal.getsignal(number) != signal.SIG_IGN:  # as under nohup
            signal.signal(number, _exit_on_signal)
    return replace(config, temp_folder=temp)


def _exit_on_signal(number: int, frame: object) -> None:
    """End the program, ignoring further signals, which would only interrupt the clean-up."""
    _is_ending.set()
    for each in _ENDING:
        signal.signal(each, signal.SIG_IGN)
    timer = threading.Timer(END_WITHIN_S, os._exit, (1,))
    timer.daemon = True
    timer.start()
    sys.exit(0)


def _remove(folder: Path) -> None:
    """Remove a folder, repeatedly, as uploads in progress may still add files."""
    for _ in range(20):
        shutil.rmtree(folder, ignore_errors=True)
        if not folder.exists():
            return
        time.sleep(0.1)


def _warm_up(worker: Worker) -> None:
    """Prepare the viewer's files, then start the worker; errors are reported by the first run."""
    try:
        from app.page.routes.media import warm_caches

        warm_caches()
        time.sleep(WARM_UP_DELAY_S)
        worker.start()
    except Exception:
        if not _is_ending.is_set():  # otherwise threads and processes cannot be started
            log.exception(
                "loading the models in advance failed; the first run will report the error"
            )
