"""Links of the documentation lead to the same things on the site as in the repository."""

import re
from pathlib import Path

import pytest

pytest.importorskip("mkdocs", reason="the extra `docs` is not installed")

from mkdocs.commands.build import build
from mkdocs.config import load_config
from mkdocs.exceptions import Abort

FILES = {
    "README.md": "# Start\n\n[docs](docs/index.md), [settings](configs/a.yaml), [terms](LICENSE)\n",
    "LICENSE": "Do as you like.\n",
    "configs/a.yaml": "links: [x](../README.md)\n",
    "usvnet/lens.py": "RAY = 1\n",
    "usvnet/other.py": "SUM = 2\n",
    "docs/index.md": "# Home\n\n[start](../README.md#start), [lens](../usvnet/lens.py), [sum](../usvnet/other.py)\n",
    "docs/guide/camera.md": "# Camera\n\n::: usvnet.lens\n\n<h2 id='usvnet.lens'>lens</h2>\n\n[home](../index.md)\n",
    "docs/guide/more.md": "# More\n\n[lens](../../usvnet/lens.py), [settings](../../configs/a.yaml)\n",
}


@pytest.fixture
def project(root: Path, tmp_path: Path) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    settings = f"site_name: x\nhooks: ['{root / 'scripts' / 'site_links.py'}']\nnot_in_nav: files/\nplugins: []\n"
    (tmp_path / "mkdocs.yml").write_text(settings)
    return tmp_path


def links(project: Path, page: str) -> dict[str, str]:
    html = (project / "site" / page / "index.html").read_text()
    body = html[html.index('role="main"') : html.index("<footer")]
    return {text: href for href, text in re.findall(r'<a href="([^"]+)">(\w+)</a>', body)}


def build_site(project: Path) -> None:
    build(load_config(str(project / "mkdocs.yml"), strict=True))


def test_links_out_of_docs_become_links_of_the_site(project: Path):
    build_site(project)
    assert links(project, ".") == {
        "start": "files/#start",
        "lens": "guide/camera/#usvnet.lens",
        "sum": "files/usvnet/other.py/",
    }
    assert links(project, "guide/more") == {"lens": "../camera/#usvnet.lens", "settings": "../../files/configs/a.yaml/"}
    assert links(project, "files") == {"docs": "../", "settings": "configs/a.yaml/", "terms": "LICENSE/"}
    for page, text in (("configs/a.yaml", "links: [x](../README.md)"), ("usvnet/other.py", "SUM")):
        assert text in re.sub(r"<.*?>", "", (project / "site" / "files" / page / "index.html").read_text())
    assert not (project / "site" / "files" / "usvnet" / "lens.py").exists()


def test_a_link_to_nothing_is_refused(project: Path):
    with (project / "docs" / "index.md").open("a") as stream:
        stream.write("\n[gone](../usvnet/gone.py)\n")
    with pytest.raises(Abort):
        build_site(project)


def test_roles_of_docstrings_become_references(root: Path):
    from runpy import run_path

    hook = run_path(str(root / "scripts" / "site_links.py"))["on_page_content"]
    html = "see :func:<code>usvnet.heatmap.decode</code>, not :func: or <code>x</code>"
    assert hook(html, None, None, None) == (
        'see <autoref identifier="usvnet.heatmap.decode" optional><code>usvnet.heatmap.decode</code></autoref>, '
        "not :func: or <code>x</code>"
    )
