"""The page behind nginx and Caddy with the files of the docs: TLS, uploads, runs, live speech."""

import contextlib
import os
import shutil
import socket
import ssl
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from app.config import AppConfig
from app.page.launch import launch
from app.page.routes import live_route
from app.page.visitors.visitors import client_network_of
from model.motion.motion import save_motion
from tests.app.page.conftest import UPLOAD
from tests.helpers import ROOT, smooth_motion_example
from tests.model.made import made_waveform
from tests.soak.visitor import Visitor
from tests.waiting import wait_for

pytestmark = pytest.mark.slow
NAME = "lab.example"
ACCOUNT = ("ann", "her pass:word")
HOSTING = ROOT / "docs" / "hosting"
SIZE_MB = 2
"""Largest body in the test, in place of the 260 MB of the files."""


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def program(package: str, name: str = "") -> str:
    """Its path; the calling test is skipped where there is none."""
    found = shutil.which(name or package, path=f"{os.environ['PATH']}:/usr/sbin")
    if found is None:
        pytest.skip(f"there is no {name or package} (apt-get install {package})")
    return found


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Of the test's own, with its key."""
    openssl = program("openssl")
    folder = tmp_path_factory.mktemp("tls")
    cert, key = folder / "cert.pem", folder / "key.pem"
    subprocess.run(
        [
            *(openssl, "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "1"),
            *("-subj", f"/CN={NAME}", "-addext", f"subjectAltName=DNS:{NAME}"),
            *("-keyout", str(key), "-out", str(cert)),
        ],
        check=True,
        capture_output=True,
    )
    return cert, key


def changed(content: str, *changes: tuple[str, str]) -> str:
    """With every change made, each of which must be there to make."""
    for old, new in changes:
        assert old in content, old
        content = content.replace(old, new)
    return content


Command = Callable[[Path, tuple[Path, Path], str, int], list[str]]


def nginx(folder: Path, certificate: tuple[Path, Path], page: str, port: int) -> list[str]:
    """The command that serves docs/hosting/nginx.conf on a port of the test's."""
    cert, key = certificate
    conf = changed(
        (HOSTING / "nginx.conf").read_text(),
        ("listen 443 ssl;", f"listen 127.0.0.1:{port} ssl;"),
        ("listen 80;", f"listen 127.0.0.1:{free_port()};"),
        (f"/etc/letsencrypt/live/{NAME}/fullchain.pem", str(cert)),
        (f"/etc/letsencrypt/live/{NAME}/privkey.pem", str(key)),
        ("http://127.0.0.1:7860", page),
        ("260m", f"{SIZE_MB}m"),
    )
    (folder / "nginx.conf").write_text(
        f"daemon off; pid {folder}/pid; error_log {folder}/log; events {{}}\n"
        f"http {{ access_log off; client_body_temp_path {folder}/body;\n{conf}\n}}\n"
    )
    return [program("nginx-light", "nginx"), "-c", str(folder / "nginx.conf"), "-p", str(folder)]


BELOW = "/lab"


def nginx_below(folder: Path, certificate: tuple[Path, Path], page: str, port: int) -> list[str]:
    """The same below a path, which nginx removes, as the docs say."""
    command = nginx(folder, certificate, page, port)
    conf = folder / "nginx.conf"
    changes = ("location / {", f"location {BELOW}/ {{"), (f"{page};", f"{page}/;")
    conf.write_text(changed(conf.read_text(), *changes))
    return command


def caddy(folder: Path, certificate: tuple[Path, Path], page: str, port: int) -> list[str]:
    """The command that serves docs/hosting/Caddyfile on a port of the test's."""
    cert, key = certificate
    conf = changed(
        (HOSTING / "Caddyfile").read_text(),
        (f"\n{NAME} {{", f"\nhttps://{NAME}:{port} {{\n\tbind 127.0.0.1\n\ttls {cert} {key}"),
        ("127.0.0.1:7860", page.removeprefix("http://")),
        ("260MB", f"{SIZE_MB}MB"),
    )
    options = "{\n\tadmin off\n\tauto_https disable_redirects\n}\n"
    (folder / "Caddyfile").write_text(options + conf)
    return [
        program("caddy"),
        "run",
        "--config",
        str(folder / "Caddyfile"),
        "--adapter",
        "caddyfile",
    ]


@contextlib.contextmanager
def behind(command: list[str], folder: Path, port: int) -> Iterator[None]:
    with (folder / "told").open("w") as told:
        proxy = subprocess.Popen(command, stdout=told, stderr=told, env={"HOME": str(folder)})
    try:

        def listens() -> bool:
            assert proxy.poll() is None, (folder / "told").read_text()
            with socket.socket() as one:
                return one.connect_ex(("127.0.0.1", port)) == 0

        wait_for(listens)
        yield
    finally:
        proxy.terminate()
        try:
            proxy.wait(5)
        except subprocess.TimeoutExpired:  # Caddy waits for open connections
            proxy.kill()
            proxy.wait(5)


@pytest.mark.parametrize(("proxy", "below"), [(nginx, ""), (caddy, ""), (nginx_below, BELOW)])
def test_behind_a_proxy_as_the_docs_say(proxy, below, certificate, weights, tmp_path, monkeypatch):
    look_up, seen = socket.getaddrinfo, []

    def looked_up(host, *arguments, **options):
        """The page's name leads to this machine."""
        return look_up("127.0.0.1" if host == NAME else host, *arguments, **options)

    def noted(request) -> str:
        """Addresses of visitors who speak, as the page sees them."""
        seen.append(client_network_of(request))
        return seen[-1]

    monkeypatch.setattr(socket, "getaddrinfo", looked_up)
    monkeypatch.setattr(live_route, "client_network_of", noted)
    port = free_port()
    address = f"https://{NAME}:{port}{below}/"
    origin = f"https://{NAME}:{port}"
    trusted = ssl.create_default_context(cafile=str(certificate[0]))
    monkeypatch.setenv("GRADIO_TEMP_DIR", "")  # launching sets it for the whole process
    settings = {"host_names": (NAME,), "accounts": (ACCOUNT,), "root_path": below}
    config = AppConfig(port=0, weights=weights, temp_folder=tmp_path / "page", **settings)
    save_motion(smooth_motion_example(45), tmp_path / "a.npz")
    motion = (tmp_path / "a.npz").read_bytes()
    sound = (30_000 * made_waveform(16_000 * 3)).astype("<i2").tobytes()
    with contextlib.closing(launch(config, preloads_models=False)) as inside:
        command = proxy(tmp_path, certificate, inside.local_url.rstrip("/"), port)
        with behind(command, tmp_path, port):
            stranger = httpx.Client(base_url=address, verify=trusted, timeout=20)
            assert stranger.get("config").status_code == 401
            assert stranger.post("gradio_api/upload", files=UPLOAD).status_code == 401
            with pytest.raises(InvalidStatus):
                connect(
                    f"wss://{NAME}:{port}{below}/live/speak",
                    ssl=trusted,
                    additional_headers={"Origin": origin},
                    open_timeout=120,
                )
            elsewhere = stranger.get("login", headers={"Host": "evil.example"})
            assert elsewhere.status_code == 421 or not elsewhere.content
            foreign = {"Origin": "https://evil.example"}
            answer = stranger.post("gradio_api/upload", files=UPLOAD, headers=foreign)
            assert answer.status_code == 403

            with Visitor(address, 6, trusted, ACCOUNT) as visitor:
                for path in ("web/player/player.js", "stage/facts.json"):
                    assert visitor._client.get(path).status_code == 200, path
                with pytest.raises(httpx.HTTPError):  # Caddy 2.6 may break off without a word
                    visitor.upload("a.npz", bytes(3 * SIZE_MB * 10**6))
                files = [path for path in (tmp_path / "page").rglob("*") if path.is_file()]
                assert all(path.stat().st_size <= SIZE_MB * 10**6 for path in files)
                upload = visitor.upload("a.npz", motion)
                form = {"motions": [upload], "has_video": False}
                news = visitor.events("own_motion", form)
                next(news)
                drawn = (tmp_path / "page").rglob("jitter.*")
                assert not list(drawn), "the news came all at once"
                assert len(list(news)) > 2
                found = visitor.run("own_motion", **form)
                assert any("jitter" in address for address in found)
                assert visitor.speak(sound, "globaldiff/global", "ann") > 0
                assert seen == ["127.0.1.7"]  # its own, and neither the proxy's nor what it says
