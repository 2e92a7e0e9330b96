"""README, documents, changelog and public docstrings are in plain English: short and usual.

The rules find words and lengths. They do not find everything that is hard to read.
"""

from __future__ import annotations

import ast
import inspect
import re
from pathlib import Path

import pytest
from test_docstrings import THINGS

from planner.app.options import COMMANDS, texts_of

ROOT = Path(__file__).parents[1]
DOCUMENTS = [
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
# contributors read it, and it defines its words
WITH_OWN_WORDS = {"architecture.md", "CONTRIBUTING.md"}
# a table of old words
OLD_WORDS = re.compile(r"^## Old and new words$.*?(?=^## |\Z)", flags=re.MULTILINE | re.DOTALL)
NOTEBOOKS = {path.stem for path in (ROOT / "notebooks").glob("*.py")}

MOST_WORDS = 30
# a part of a sentence between semicolons, colons and dashes
MOST_WORDS_OF_A_CLAUSE = 24

# expression, and what to write instead
FORBIDDEN = {
    r"(is|are|was|were) (told|said to|looked at|promised)": "say who does it",
    r"(is|are) (looked|asked|tried|searched|sought) (for|at|of|whether|if)": "the program searches",
    r"it is (tried|tested|asked|checked|looked|said) (whether|if)": "the program checks",
    r"(is|are) asked": "the plan requires",
    r"has to be (looked|searched|asked)": "an imperative: search for",
    r"tells?(?! us)": "prints, shows, lists, reports",
    r"told": "printed, shown, known",
    r"beside": "in addition to, besides, next to",
    r"so (far|near|many|much|little) (to|of|as|around|the|an?|entities|seconds)": "up to, at most",
    r"(?<!thing )(?<!what )else": "otherwise",
    r"whoever|thereof|therein|hereby|upon|hence|whence|thus|whereby|wherein|whilst": "a usual word",
    r"lest|albeit|ought|all the same": "so that not, although, should, nevertheless",
    r"(of|at|in|from|by|for|than) what (is|are|was|no)": "a noun, not a clause",
    r"what (is|was) (measured|asked|missing|found|planned|needed|left|not)": "a noun: target, edge",
    r"what no [a-z]+": "a noun: unlit edges",
    r"to which side": "in which direction",
    r"as long as that": "while",
    r"in the place of": "instead of",
    r"be of use": "help, be useful",
    r"but for": "except",
    r"(, for|; for) (it|they|this|that|he|these) (is|are|was|has|have|does|do)": "because",
    r"gives? up": "stops, discards",
    r"has no say|has the last word|knows? (no|nothing)": "say what it does not do",
    r"of each (edge|rim|part|dimension) (whether|the|its|there)": "start with the subject",
    r"run(s)? on smoothly": "ends in a tangent arc",
}
# words of the code that a reader does not know
PRIVATE = {
    r"houses?": "package",
    r"rooms?": "folder, range",
    r"places?": "position, point",
    r"(?<!camera )bod(y|ies)": "camera, solid",
    r"reserves?": "safety margin",
    r"showing|shown as": "image conditions, drawn as",
    r"referees?": "independent check",
    r"(more|a|the|its|each) sides? (of needed|broken|moves?|that moves?|of members)": "condition",
    r"points? looked at": "look point",
}

FENCED = re.compile(r"^```.*?^```$", flags=re.MULTILINE | re.DOTALL)
# a command after an empty line, not the second line of an item
INDENTED = re.compile(r"(?<=\n\n)(?: {4}.*\n?)+")
FORMULA = re.compile(r"\$\$.*?\$\$|\$[^$]*\$", flags=re.DOTALL)
CODE = re.compile(r"``[^`]+``|`[^`]+`")
LINK = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")
NUMBER = re.compile(r"[-−+±]?\d[\d.,·/%°^]*")
# not the end of a sentence
ABBREVIATION = re.compile(r"\b(e\.g|i\.e|vs|cf|eqs?|No|Proc|Robotic|Systems?|s\.d|r\.m\.s|[A-Z])\.")


def blocks(text):
    """Yield paragraphs, items of lists, headings and cells of tables, without code and formulas."""
    text = FENCED.sub("", OLD_WORDS.sub("", text))
    text = FORMULA.sub("x", text)
    text = INDENTED.sub("", text)
    text = CODE.sub("code", text)
    text = LINK.sub(r"\1", text)
    for paragraph in re.split(r"\n\s*\n|\n(?=\s*(?:[*-]|\d+\.)\s)|\n(?=[|#>])", text):
        line = re.sub(r"^\s*(?:[*-]|\d+\.|#+|>)\s+", "", paragraph)
        if line.lstrip().startswith("|"):
            yield from (cell.strip() for cell in line.split("|") if cell.strip(" -:"))
        elif line.strip() and line.strip() not in NOTEBOOKS:
            yield " ".join(line.split())


def sentences(block):
    """Split a block at the ends of its sentences."""
    block = ABBREVIATION.sub(lambda match: match[0].replace(".", ""), block.replace("*", ""))
    return [one for one in re.split(r"(?<=[.?!∎])\s+", block) if one]


def words(sentence):
    """Words without code, numbers and marks."""
    plain = NUMBER.sub(" ", sentence).replace("code", " ")
    return [
        word for word in re.findall(r"[^\W\d_][\w'’-]*", plain) if len(word) > 1 or word in "aI"
    ]


def find_long(text):
    """Sentences and clauses that are too long, with their number of words."""
    long = []
    for block in blocks(text):
        for sentence in sentences(block):
            if len(words(sentence)) > MOST_WORDS:
                long.append((len(words(sentence)), sentence))
                continue
            for clause in re.split(r"[;:()–]|, (?:and|but|so|or) ", sentence):
                if len(words(clause)) > MOST_WORDS_OF_A_CLAUSE:
                    long.append((len(words(clause)), clause.strip()))
    return long


def find_forbidden(text, rules):
    """What matches a rule, with what to write instead and the sentence."""
    return [
        (match[0], instead, sentence)
        for block in blocks(text)
        for sentence in sentences(block)
        for rule, instead in rules.items()
        for match in re.finditer(rf"(?<![\w-])(?:{rule})(?![\w-])", sentence, flags=re.IGNORECASE)
    ]


def find_semicolons(text):
    """Sentences with a semicolon between clauses; tables, brackets and lists may have them."""
    return [
        sentence
        for paragraph in re.split(r"\n\s*\n", FENCED.sub("", text))
        if not re.match(r"\s*(\||[*-] |\d+\. |#|    )", paragraph)
        for block in blocks(paragraph)
        for sentence in sentences(block)
        if ";" in re.sub(r"\([^)]*\)", "", sentence).rstrip(";")
    ]


def rules_for(path):
    return FORBIDDEN if path.name in WITH_OWN_WORDS else {**FORBIDDEN, **PRIVATE}


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_sentences_are_short(path):
    assert find_long(path.read_text("utf-8")) == []


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_words_are_usual(path):
    assert find_forbidden(path.read_text("utf-8"), rules_for(path)) == []


@pytest.mark.parametrize(
    "path",
    [path for path in DOCUMENTS if path.parent.name != "mathematics"],
    ids=lambda path: str(path.relative_to(ROOT)),
)
def test_clauses_are_sentences(path):
    assert find_semicolons(path.read_text("utf-8")) == []


HEADING = re.compile(r"^[A-Z][\w ]+\n-{3,}$", flags=re.MULTILINE)
EXAMPLE = re.compile(r"^Examples\n-{3,}\n.*?(?=^[A-Z][\w ]+\n-{3,}$|\Z)", re.MULTILINE | re.DOTALL)
# a change of the text would compile the loops of its module anew
LONG_SENTENCES = {"errors.referee.simulate_success"}


DOCSTRINGS = {name: inspect.getdoc(thing) or "" for name, thing in THINGS.items()}


def docstring_prose(docstring):
    """Summary and descriptions of a numpydoc docstring, without names, types and examples."""
    summary, *sections = HEADING.split(EXAMPLE.sub("", docstring))
    for section in sections:
        lines = section.split("\n")
        entries = any(line.startswith("    ") for line in lines)
        summary += "\n\n" + "\n".join(
            line[4:] if line.startswith("    ") else "" if entries else line for line in lines
        )
    return summary


@pytest.mark.parametrize("name", DOCSTRINGS)
def test_docstrings_use_usual_words(name):
    text = docstring_prose(DOCSTRINGS[name])
    assert find_forbidden(text, {**FORBIDDEN, **PRIVATE}) == []
    assert name in LONG_SENTENCES or find_long(text) == []


def test_an_old_docstring_is_noticed():
    old = """Find a pose.

    Parameters
    ----------
    lamps : array
        What no lamp shows is looked for from other poses.

    Examples
    --------
    >>> told = 1
    """
    words_found = [
        match
        for match, _, _ in find_forbidden(
            docstring_prose(inspect.cleandoc(old)), {**FORBIDDEN, **PRIVATE}
        )
    ]
    assert words_found == ["is looked for", "What no lamp"]


def test_names_and_types_of_a_docstring_are_no_prose():
    text = docstring_prose("Find.\n\nParameters\n----------\nplaces : told\n    Points.\n")
    assert text.split() == ["Find.", "Points."]


# what builds a message, by its arguments; a rule, a hint or a reason is one, too
MESSAGE_CALLS = {"of_rule", "print_text", "note", "write_error", "_Refusal", "UsageError"}
MESSAGE_NAMES = {"rule", "hint", "reason", "title"}
CODE_FOLDERS = ("aspectgraph", "errors", "ga", "ground", "planner")


def message_roots(tree):
    """Expressions of a module that hold the text of messages."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise) and node.exc is not None:
            yield node.exc
        elif isinstance(node, ast.Call):
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if name in MESSAGE_CALLS:
                yield from (*node.args, *(keyword.value for keyword in node.keywords))
        elif (isinstance(node, ast.keyword) and node.arg in MESSAGE_NAMES) or (
            isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") in MESSAGE_NAMES
        ):
            yield node.value


def texts_in(node):
    """Texts of an expression; a value in a text is an x."""
    if isinstance(node, ast.Constant):
        return [node.value] if isinstance(node.value, str) else []
    if isinstance(node, ast.JoinedStr):
        parts = (part.value if isinstance(part, ast.Constant) else "x" for part in node.values)
        return ["".join(parts)]
    return [text for child in ast.iter_child_nodes(node) for text in texts_in(child)]


def messages(source):
    """Texts of more than a word that messages of a module are made of."""
    texts = {text for root in message_roots(ast.parse(source)) for text in texts_in(root)}
    return sorted(text for text in texts if len(text.split()) > 1)


@pytest.mark.parametrize("folder", CODE_FOLDERS)
def test_messages_use_usual_words(folder):
    count = 0
    for path in sorted((ROOT / folder).rglob("*.py")):
        for text in messages(path.read_text("utf-8")):
            count += 1
            assert find_forbidden(text, {**FORBIDDEN, **PRIVATE}) == [], path
            assert find_long(text) == [], path
    assert count > 10 or folder == "ground"


@pytest.mark.parametrize("name", COMMANDS)
def test_help_uses_usual_words(name):
    for text in (inspect.getdoc(COMMANDS[name]) or "", *texts_of(COMMANDS[name]).values()):
        assert find_forbidden(text.partition("Attributes")[0], {**FORBIDDEN, **PRIVATE}) == []


def test_an_old_message_is_noticed():
    source = """def f(n):
    rule = "must be what was asked for"
    raise RequestError.of_rule("n", f"of which {n} is looked for", repr(n))
"""
    assert messages(source) == ["must be what was asked for", "of which x is looked for"]
    assert all(find_forbidden(text, FORBIDDEN) for text in messages(source))


def test_readme_is_short():
    text = (ROOT / "README.md").read_text("utf-8")
    assert sum(len(words(block)) for block in blocks(text)) <= 700


def test_all_documents_are_read():
    """Nothing passes because nothing is looked at."""
    assert len(DOCUMENTS) > 25
    for path in DOCUMENTS:
        text = path.read_text("utf-8")
        found = sum(len(words(block)) for block in blocks(text))
        assert found > 0.3 * len(OLD_WORDS.sub("", FENCED.sub("", text)).split()), path


# sentences of earlier documents
OLD = (
    "What a plan asks of the image for that, and where to look, tells `docs/showing.md`.",
    "Else answers are those for a part whose vertices are displaced by up to `snapping_mm`.",
    "What takes longer than about twenty seconds more is told with how long.",
    "How long a whole plan takes is not told beforehand; of each of its steps it is, once it has begun.",
    "A plan that is told of on the way is a cover of which simulation supports all it counts on.",
    "The edge itself must leave two separations between what lines at its own ends are beside of.",
    "So far to either side of its prediction what is measured has to be looked for.",
    "9 of 90 edges run on smoothly at an end (tangent).",
    "Before the work it is tried whether everything can be written.",
    "What no lamp shows is looked for from other poses.",
    "The report puts margins on one scale, as shares of the room their constraints have.",
    "Its camera is the body and the lens; the reserve of focus is in the report.",
    "`plan_light` finds few places for a lamp.",
)
NEW = (
    "See `docs/showing.md` for what the image must contain and where to search.",
    "Otherwise vertices move by at most `snapping_mm`.",
    "A first plan appears within seconds and is then improved.",
    "Steps expected to take more than 20 s print an estimate.",
    "There is no estimate for the whole plan, only for each step once it has started.",
    "Every intermediate plan is checked by simulation.",
    "Lamp positions are computed exactly, like viewpoints.",
    "Search this far on either side of the predicted edge.",
    "9 edges end in a tangent arc, so their length is undefined.",
    "STEP files need the `[step]` extra and Python 3.11 or newer.",
)


@pytest.mark.parametrize("sentence", OLD)
def test_an_old_sentence_is_noticed(sentence):
    assert find_forbidden(sentence, {**FORBIDDEN, **PRIVATE})


@pytest.mark.parametrize("sentence", NEW)
def test_a_plain_sentence_passes(sentence):
    assert find_forbidden(sentence, {**FORBIDDEN, **PRIVATE}) == []
    assert find_long(sentence) == []
    assert find_semicolons(sentence) == []


def test_a_long_sentence_is_noticed_wherever_it_stands():
    long = " ".join(["word"] * (MOST_WORDS + 1)) + "."
    for text in (long, f"* {long}", f"| a | {long} |", f"# {long}", f"Short. {long}", f"> {long}"):
        assert find_long(text), text
    clause = " ".join(["word"] * (MOST_WORDS_OF_A_CLAUSE + 1))
    assert find_long(f"It is so: {clause}.")
    assert find_semicolons("This is one clause; this is another one.")


def test_code_and_formulas_are_no_prose():
    code = " ".join(["else told"] * MOST_WORDS)
    for text in (
        f"```python\n{code}\n```",
        f"Text.\n\n    aspectgraph {code}\n\nText.",
        f"Call `{code}`.",
        f"Then ${code}$.",
        f"$$ {code} $$",
        f"[text]({code.replace(' ', '_')})",
    ):
        assert find_long(text) == [], text
        assert find_forbidden(text, FORBIDDEN) == [], text
