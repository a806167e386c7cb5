"""The page and its configuration from memory: what Gradio would answer, built once."""

import pytest
from starlette.testclient import TestClient

from app.page.routes.guard import Guard
from app.page.routes.page_cache import INFO, PATHS, PageCache
from tests.app.page.conftest import ADDRESS, served_page

HOSTS = ("127.0.0.1", "localhost:80", "lab.example:8443", "localhost:", "LOCALHOST:00080")
QUERIES = ("", "?page=", "?run=%E2%80%AE&__theme=dark", "?deep_link=a&page=b&all_endpoints=1")
ACCOUNT = ("ann", "her pass:word")


class Counted:
    """Gradio's app, and how often it was asked."""

    def __init__(self, pages: PageCache) -> None:
        self.inner, self.num_asked = pages.inner, 0
        pages.inner = self

    async def __call__(self, scope, receive, send) -> None:
        self.num_asked += 1
        await self.inner(scope, receive, send)


@pytest.mark.parametrize("root_path", ["", "/bench", "https://lab.example/bench"])
def test_answers_are_gradios_and_built_once(weights, tmp_path, root_path):
    settings = {
        "host_names": ("lab.example",),
        "root_path": root_path,
        "trusted_proxies": ("10.0.0.1",),
    }
    with served_page(weights, tmp_path, **settings) as page:
        guard = page.app.middleware_stack
        assert isinstance(guard, Guard) and isinstance(guard.inner, PageCache)
        counted, client = Counted(guard.inner), page.visitor()
        for forwarded in ({}, {"X-Forwarded-Host": "lab.example", "X-Forwarded-Proto": "https"}):
            for path, host in ((path, host) for path in PATHS for host in HOSTS):
                headers = {**forwarded, "Host": host}
                cached = client.get(path, headers=headers)
                direct = TestClient(counted.inner, ADDRESS, root_path=root_path)
                page.app.api_info = None
                expected = direct.get(path, headers=headers)
                assert cached.text == expected.text, (path, host)
                assert cached.headers["content-type"] == expected.headers["content-type"]
                head = client.head(path, headers=headers)
                assert (head.content, head.headers["content-length"]) == (
                    b"",
                    cached.headers["content-length"],
                )
        assert counted.num_asked == 4
        pages = [client.get(f"/{query}").text for query in QUERIES]
        assert set(pages) == {client.get("/").text}
        configs = [client.get(f"/config/{query}").json() for query in QUERIES]
        assert [config.get("current_page") for config in configs] == [None, "", None, None]
        assert counted.num_asked == 5, "for the page that was named"
        expected = TestClient(counted.inner, ADDRESS, root_path=root_path)
        for query in (*QUERIES, "?all_endpoints=1&page=", "?all_endpoints="):
            page.app.api_info = None
            info = client.get(f"{INFO}{query}").text
            assert info == expected.get(f"{INFO}{query}").text, query
        assert counted.num_asked == 8, "hidden functions or not, of the page that was named or not"
        page.app.get_blocks().config = {**page.app.get_blocks().config, "title": "another"}
        assert client.get("/config").json()["title"] == "another"
        assert ".invalid" not in client.get(INFO).text


def test_who_has_not_logged_in_gets_no_page_of_another(weights, tmp_path):
    with served_page(weights, tmp_path, accounts=(ACCOUNT, ("bob", "b"))) as page:
        stranger, ann, bob = page.visitor(), page.visitor(), page.visitor()
        for client, (name, password) in ((ann, ACCOUNT), (bob, ("bob", "b"))):
            client.post("/login", data={"username": name, "password": password})
            assert client.get("/config").json()["username"] == name
            assert f'"username":"{name}"' in client.get("/").text
        assert stranger.get("/").headers["connection"] == "close", "asked once, not a hundred times"
        for _ in range(2):
            assert stranger.get("/config").status_code == 401
            assert stranger.get(INFO).status_code == 401
            assert '"auth_required":true' in stranger.get("/").text
        assert ann.get("/config").json()["username"] == "ann"
        ann.get("/logout")
        assert ann.get("/config").status_code == 401
