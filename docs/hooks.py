"""A hook of mkdocs that adds files from outside docs/ to the site.

The README is the first page. Notebooks, and other pages and files of the repository that a page
links to, get a place in the site. Links are rewritten for the site; in the repository the same
links work unchanged.
"""

import logging
import posixpath
import re
import sys
from html import unescape
from inspect import isfunction
from pathlib import Path

from mkdocs.structure.files import File

ROOT = Path(__file__).parents[1]
# Pages of the repository outside docs/, by their place in the site.
PAGES = {
    "index.md": "README.md",
    "CONTRIBUTING.md": "CONTRIBUTING.md",
    "SECURITY.md": "SECURITY.md",
    "CHANGELOG.md": "CHANGELOG.md",
    "jaxcontact/data/SOURCES.md": "jaxcontact/data/SOURCES.md",
}
LINK = re.compile(r"(?<=\]\()(?!\w+:|#)([^)#\s]+)")
# An output of code; or, outside of it, a tag, a name or a number with its exponent and unit.
PRINTED = re.compile(r'(<div class="language-text highlight">.*?<code>)(.*?)(</code>)', re.DOTALL)
WHOLE = re.compile(
    r"<pre.*?</pre>|(<code>[^<]{1,34}</code>|(?<![\w.#&])\d[\d.,]*(?:e-\d+|(?:e[-+]?\d+)? "
    r"(?:%|million|billion|[µm]?s|mm?|kg)(?!\w)))|<[^>]*>",
    re.DOTALL,
)
PICTURE = re.compile(r'(?<=<p>)(<img [^>]*src="([^"]+)"[^>]*>)(?=</p>)')
# A sentence for readers of the repository.
NOTE = re.compile(r"^In the repository .*\n", re.MULTILINE)
# A name of the reference that no signature follows.
NAKED = re.compile(
    r'<h3 id="jaxcontact\.(\w+)"(?:(?!</h3>).)*</h3>'
    r'(?!\s*<div class="[\w -]*(?:signature|overloads))',
    re.DOTALL,
)
LOG = logging.getLogger("mkdocs.plugins.hooks")
LONGEST = 100  # characters of a line of code


def on_files(files, config):
    """Add the pages and files outside of docs/."""
    for place, source in PAGES.items():
        files.append(_page(place, (ROOT / source).read_text(encoding="utf-8"), source, config))
    for notebook in sorted((ROOT / "notebooks").glob("*.ipynb")):
        for file in _notebook(notebook, config):
            files.append(file)
    for page in list(files.documentation_pages()):
        text = page.content_string
        here = _source_of(page)
        for target in LINK.findall(text):
            wanted = _repository_path(here, target)
            place = _place(wanted)
            if files.get_file_from_path(place) is None and (ROOT / wanted).is_file():
                source = str(ROOT / wanted)
                files.append(File.generated(config, place, abs_src_path=source))
    # mkdocs restores sys.path after it has loaded a hook.
    sys.path.insert(0, str(ROOT))
    from jaxcontact.lab.explore import page as interactive

    files.append(File.generated(config, "explore_page.html", content=interactive()))
    return files


def on_page_markdown(markdown, page, config, files):
    """Turn links of the repository into links within the site."""
    here = _source_of(page.file)
    folder = posixpath.dirname(page.file.src_uri)

    def moved(found):
        place = _place(_repository_path(here, found[1]))
        return (
            posixpath.relpath(place, folder or ".") if files.get_file_from_path(place) else found[1]
        )

    return LINK.sub(moved, NOTE.sub("", markdown))


def on_page_content(html, page, config, files):
    """Wrap printed sentences, keep numbers and names whole, and link each picture to itself."""
    for name in NAKED.findall(html):
        if isfunction(getattr(sys.modules["jaxcontact"], name, None)):
            LOG.warning("%s shows %s without its arguments", page.file.src_uri, name)
    html = PRINTED.sub(lambda x: x[1] + "\n".join(map(_printed, x[2].split("\n"))) + x[3], html)
    html = WHOLE.sub(lambda x: f'<span class="whole">{x[1]}</span>' if x[1] else x[0], html)
    return PICTURE.sub(r'<a href="\2">\1</a>', html)


def _printed(line):
    text = unescape(re.sub("<[^>]*>", "", line))
    # The rows of a table have several gaps, and stay under each other.
    if len(text) <= LONGEST or len(re.findall(r"\S {2,}\S", text)) > 1:
        return line
    return f'<span class="sentence">{line}</span>'


def _joined(outputs):
    """Return outputs with what was printed piece by piece as one."""
    joined = []
    for output in outputs:
        if joined and output.output_type == joined[-1].output_type == "stream":
            joined[-1].text += output.text
        else:
            joined.append(output)
    return joined


def _source_of(file):
    """Return the path of a page in the repository."""
    place = file.src_uri
    return PAGES.get(place) or (place if place.startswith("notebooks/") else f"docs/{place}")


def _repository_path(here, target):
    return posixpath.normpath(posixpath.join(posixpath.dirname(here), target))


def _place(path):
    """Return the place in the site of a file of the repository."""
    back = {source: place for place, source in PAGES.items()}
    if path.startswith("notebooks/"):
        return re.sub(r"\.ipynb$", ".md", path)
    return back.get(path, path.removeprefix("docs/"))


def _page(place, text, source, config):
    return File.generated(config, place, content=text)


def _notebook(path, config):
    """Yield a notebook as a page, and its pictures, as committed."""
    import nbformat
    from nbconvert import MarkdownExporter

    notebook = nbformat.read(path, as_version=4)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            # Progress bars are written to stderr.
            cell.outputs = _joined(x for x in cell.outputs if x.get("name") != "stderr")
    names = {"output_files_dir": f"{path.stem}_files", "unique_key": path.stem}
    text, found = MarkdownExporter().from_notebook_node(notebook, resources=names)
    yield File.generated(config, f"notebooks/{path.stem}.md", content=text)
    for picture, data in found["outputs"].items():
        yield File.generated(config, f"notebooks/{picture}", content=data)
