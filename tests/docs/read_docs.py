"""Reads README.md and the pages of docs/ for tests/commands/docs.rs. Needs the standard library only.

Prints one JSON object:

commands  every `carved ...` command line of the sh blocks: {"at": "docs/tutorial.md:63", "argv": [..]}
spans     every `carved ...` in running text, in the same form. A span may leave out what the command requires.
options   every `--option ...` in running text, in the same form
mistakes  what this program itself finds: an sh block that no shell can read, Python and TOML that cannot be parsed,
          a name that carved_client does not have, a relative link to a file or a heading that does not exist, the path
          of a source file that does not exist, and a request that docs/openapi.json does not have
"""

import ast
import json
import os
import re
import shlex
import sys
import tomllib
from pathlib import Path

from links import SPAN, dead, split

ROOT = Path(__file__).resolve().parents[2]
CLIENT = ROOT / "clients/python/src/carved_client"
REQUEST = re.compile(r"(GET|PUT|POST|DELETE) (/[^\s?]*)")
# The path of a source file or of a folder of sources, from the root or from a folder that the page has named.
SOURCE = re.compile(r"[\w-]+(/[\w.-]+)+\.(rs|py|ts|mjs|sh)|(src|crates|hardware-sim|tests|web)/([\w.-]+/)*")
# Part of a path that stands for any name.
PLACEHOLDER = re.compile(r"[A-Z]{2}")
OPERATORS = ";&|()<>"
# Words before a command that are not its name.
LEADING = {"do", "then", "else", "sudo", "exec", "time", "!"}
# Options of sudo with a value.
OF_SUDO = {"-u", "-g"}

mistakes: list[str] = []


def pages():
    """The pages that are read: those of docs/, and those beside the sources that a user reads."""
    top = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "clients/python/README.md"]
    crates = [*ROOT.glob("crates/*/README.md"), ROOT / "hardware-sim/README.md"]
    return [ROOT / name for name in top] + sorted(crates) + sorted((ROOT / "docs").rglob("*.md"))


def words(line):
    """The words and operators of one line of shell. A ValueError means that a quotation is still open."""
    lexer = shlex.shlex(re.sub(r"(?<=\s)2>(&1)?", ">", line), posix=True, punctuation_chars=OPERATORS)
    lexer.whitespace_split = True
    return list(lexer)


def commands(text):
    """Each simple command of a piece of shell, as (line within the text, words). Redirections are left out."""
    found, held, start = [], "", 0
    for number, line in enumerate(text.splitlines()):
        start = start if held else number
        held += line
        if held.endswith("\\"):
            held = held[:-1]
            continue
        try:
            tokens = words(held)
        except ValueError:
            held += "\n"
            continue
        held = ""
        argv, redirected = [], False
        for token in [*tokens, ";"]:
            if set(token) <= set("<>&|") and ("<" in token or ">" in token):
                redirected = True
            elif token and set(token) <= set(OPERATORS):
                while argv and (argv[0] in LEADING or re.match(r"\w+=", argv[0])):
                    if argv.pop(0) == "sudo":
                        while argv and argv[0] in OF_SUDO:
                            argv = argv[2:]
                if argv:
                    found.append((start, argv))
                argv, redirected = [], False
            elif not redirected:
                argv.append(token)
    if held:
        raise ValueError("a quotation is still open at the end")
    return found


def check_python(at, text):
    """Python that can be parsed, and uses only names that carved_client has."""
    try:
        tree = ast.parse(text)
    except SyntaxError as error:
        mistakes.append(f"{at}: no Python: {error}")
        return
    exported = ast.parse((CLIENT / "__init__.py").read_text())
    exports = {
        value
        for node in exported.body
        if isinstance(node, ast.Assign) and node.targets[0].id == "__all__"
        for value in ast.literal_eval(node.value)
    }
    methods = {
        node.name for file in CLIENT.glob("*.py") for node in ast.walk(ast.parse(file.read_text())) if isinstance(node, ast.FunctionDef)
    }
    clients = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module == "carved_client":
            for name in node.names:
                if name.name not in exports:
                    mistakes.append(f"{at}: carved_client has no {name.name}")
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("carved_client."):
            parts = node.module.split(".")[1:]
            if not any(CLIENT.joinpath(*parts).with_suffix(end).exists() for end in ("", ".py")):
                mistakes.append(f"{at}: there is no module {node.module}")
        elif isinstance(node, ast.Assign) and getattr(getattr(node.value, "func", None), "id", "") == "CarvedClient":
            clients |= {target.id for target in node.targets if isinstance(target, ast.Name)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and getattr(node.value, "id", None) in clients and node.attr not in methods:
            mistakes.append(f"{at}: CarvedClient has no {node.attr}")


def sources():
    """Paths of the files and folders of the project, each after a slash."""
    found = []
    for folder, folders, files in os.walk(ROOT):
        folders[:] = [name for name in folders if name not in ("target", "node_modules", ".git", ".venv")]
        path = "/" + Path(folder).relative_to(ROOT).as_posix()
        found += [f"{path}/{name}" for name in files] + [f"{path}/"]
    return found


def routes():
    """Patterns of every method and path of the contract. A page may name a parameter otherwise, or give a value."""
    paths = json.loads((ROOT / "docs/openapi.json").read_text())["paths"]
    lines = [f"{method.upper()} {re.sub('{[^}]+}', '[^/]+', path)}" for path, methods in paths.items() for method in methods]
    return re.compile("|".join(lines))


def main():
    """Read all pages and print what they have."""
    known, files = routes(), sources()
    found = {"commands": [], "spans": [], "options": [], "mistakes": mistakes}
    for page in pages():
        name = page.relative_to(ROOT)
        mistakes.extend(dead(ROOT, page))
        blocks, paragraphs = split(page)
        for line, language, text in blocks:
            at = f"{name}:{line}"
            if language == "sh":
                try:
                    lines = commands(text)
                except ValueError as error:
                    mistakes.append(f"{at}: no shell can read this block: {error}")
                    continue
                for offset, argv in lines:
                    if Path(argv[0]).name == "carved":
                        found["commands"].append({"at": f"{name}:{line + offset}", "argv": argv})
            elif language == "python":
                check_python(at, text)
            elif language == "toml":
                try:
                    tomllib.loads(text)
                except tomllib.TOMLDecodeError as error:
                    mistakes.append(f"{at}: no TOML: {error}")
        for line, text in paragraphs:
            for span in SPAN.finditer(text):
                request = REQUEST.match(span[2])
                if request and not known.fullmatch(request[0]):
                    mistakes.append(f"{name}:{line}: docs/openapi.json has no {request[0]}")
                is_source = SOURCE.fullmatch(span[2]) and not PLACEHOLDER.search(span[2])
                if is_source and not any(file.endswith(f"/{span[2]}") for file in files):
                    mistakes.append(f"{name}:{line}: there is no {span[2]}")
                kind = {"carved": "spans", "--": "options"}.get(re.match(r"(carved(?= )|--|)", span[2])[0])
                if kind is None:
                    continue
                at = f"{name}:{line + text[: span.start()].count(chr(10))}"
                # In running text `near|far` is a choice; a pipe has spaces around it.
                shell = re.sub(r"(\w)\|\w+", r"\1", " ".join(span[2].split()))
                found[kind].append({"at": at, "argv": commands(shell)[0][1]})
    json.dump(found, sys.stdout)


main()
