"""Checks that nothing of ours grows too large to hold in the head.

    sizes.py SOURCE_FOLDER [--largest N]

Reported, one line each:
  * a class, struct or union with more than FIELDS data members or PUBLIC_METHODS public member functions;
  * a function of more than FUNCTION_LINES lines, from the first line of its declaration to its last brace;
  * a header of more than HEADER_LINES lines;
  * a line of more than COLUMNS columns in C++, Python, shell, JavaScript or CMake.
--largest prints the N largest classes by fields and by public methods instead. Ends with 0 where there is nothing to
report, else with 1.

Members are read from the text, without a compiler: preprocessor lines count for nothing, both sides of an #if count. A data
member is one per object: static members are none, those of an unnamed struct or union belong to the class around it. Public
methods are those declared in the class itself, overloads, constructors and operators included, deleted ones excepted.
"""

import dataclasses
import pathlib
import re
import sys
from typing import NamedTuple

FIELDS = 15
PUBLIC_METHODS = 25
FUNCTION_LINES = 60
HEADER_LINES = 300
COLUMNS = 110
FOLDERS = ("proto", "server", "worker", "client", "filter")
CODE = (".h", ".cc", ".py", ".sh", ".js", ".cmake")

# What tokens cannot stand in, longest first: raw strings, strings, characters, comments, preprocessor lines.
OPAQUE = re.compile(r'R"(?P<mark>[^ ()\\\n]*)\(.*?\)(?P=mark)"'
                    r'|"(?:\\.|[^"\\\n])*"'
                    r"|(?<![0-9a-fA-F])'(?:\\.|[^'\\\n])+'"
                    r"|//(?:\\\n|[^\n])*"
                    r"|/\*.*?\*/"
                    r"|^[ \t]*#(?:\\\n|/\*.*?\*/|[^\n])*", re.S | re.M)
TOKEN = re.compile(r"[A-Za-z_]\w*|\d[\w.']*|::|->|[^\s\w]")
CLOSING = {"(": ")", "[": "]", "{": "}"}
ACCESS = ("public", "protected", "private")
CLASS = ("class", "struct", "union")
NO_MEMBER = ("using", "typedef", "friend", "static_assert", "static", "enum", *CLASS)
MACRO = re.compile(r"[A-Z][A-Z0-9]*_[A-Z0-9_]+$")  # of an attribute, such as ABSL_GUARDED_BY


class Token(NamedTuple):
    text: str  # of a group in brackets its two brackets: "()", "[]", "{}", "<>"
    line: int
    inside: list = []  # of a group, its tokens


@dataclasses.dataclass
class Class:
    file: str
    line: int
    name: str
    fields: int = 0
    public_methods: int = 0


@dataclasses.dataclass
class Function:
    file: str
    line: int
    name: str
    lines: int


def tokens_of(text):
    """The tokens of C++ source, groups in round, square and curly brackets folded."""

    def blank(match):
        filler = '""' if match.group().startswith(('"', "R", "'")) else ""
        return filler + "\n" * match.group().count("\n")

    open_groups = [Token("", 0, [])]
    for line, code in enumerate(OPAQUE.sub(blank, text).split("\n"), 1):
        for match in TOKEN.finditer(code):
            word = match.group()
            if word in CLOSING:
                open_groups.append(Token(word + CLOSING[word], line, []))
            elif word in CLOSING.values() and len(open_groups) > 1:
                group = open_groups.pop()
                group.inside.append(Token(word, line))  # tells where the group ends
                open_groups[-1].inside.append(group)
            else:
                open_groups[-1].inside.append(Token(word, line))
    return open_groups[0].inside


def is_word(token):
    return re.match(r"[A-Za-z_]", token.text) is not None


def with_angles_folded(head):
    """`head` with template arguments as groups; what only looks like their bracket stays."""
    folded = []
    starts = []  # where in `folded` those begin that are open
    for i, token in enumerate(head):
        if token.text == "<" and i > 0 and is_word(head[i - 1]) and head[i - 1].text != "operator":
            starts.append(len(folded))
        if token.text == ">" and starts:
            start = starts.pop()
            folded[start:] = [Token("<>", folded[start].line, folded[start + 1:])]
        else:
            folded.append(token)
    return folded


def plain(head):
    """`head` without template<...>, attributes and the macros of attributes."""
    kept = []
    for token in with_angles_folded(head):
        previous = kept[-1].text if kept else ""
        if token.text == "<>" and previous == "template":
            kept.pop()
        elif token.text == "()" and (previous in ("alignas", "decltype", "requires", "explicit", "noexcept")
                                     or MACRO.match(previous)):
            kept.pop()
        elif token.text == "[]" and token.inside[0].text == "[]":
            pass
        else:
            kept.append(token)
    return kept


def words_of(head):
    return [token.text for token in head]


def is_function(head):
    """Whether a plain head, up to a body or a semicolon, declares a function: round brackets before any initializer."""
    words = words_of(head)
    if "operator" in words:
        return True
    before = words[:words.index("=")] if "=" in words else words
    if "()" not in before:
        return False
    first = head[before.index("()")]
    return not (first.inside[0].text in "*&" and before.count("()") == 2)  # else a pointer to a function


def begins_body(head):
    """Whether the curly brackets after a plain head are a function's body, not an initializer."""
    if not is_function(head):
        return False
    words = words_of(head)
    after = words[words.index("()") + 1:]
    if ":" not in after:
        return True
    return after[-1] in ("()", "{}")  # the initializers of members are over


def declares_class(head):
    """Whether curly brackets after a plain head hold the members of a class."""
    words = [word for word in words_of(head) if word not in ("static", "constexpr", "const", "inline", "typedef", "mutable")]
    return bool(words) and words[0] in CLASS and "=" not in words and "()" not in words


def name_of_class(head):
    words = words_of(head)
    words = words[1:words.index(":")] if ":" in words else words[1:]
    names = [word for word in words if re.match(r"[A-Za-z_]", word) and word != "final"]
    return names[-1] if names else ""


def name_of_function(head):
    words = words_of(head)
    if "operator" in words:
        return "".join(words[words.index("operator"):][:2])
    name = re.search(r"((?:\w+ (?:<> )?:: )*(?:~ )?\w+) (?:<> )?\(\)", " ".join(words))
    return re.sub("<>| ", "", name.group(1)) if name else "without a name"


def declarators(head):
    """How many variables a plain head declares."""
    return words_of(head).count(",") + 1


class Reader:
    """Collects the classes and functions of one file."""

    def __init__(self, file, text):
        self.file = file
        self.classes = []
        self.functions = []
        self.read_scope(tokens_of(text), None, "public")

    def read_scope(self, tokens, owner, access):
        """Reads the declarations of a namespace, or of the class `owner`."""
        head = []
        unnamed = None  # the class without a name whose declarators may follow
        for token in tokens:
            if token.text == ":" and len(head) == 1 and head[0].text in ACCESS:
                access = head[0].text
                head = []
            elif token.text == ";":
                self.add_members(plain(head), owner, access, unnamed)
                head, unnamed = [], None
            elif token.text != "{}":
                head.append(token)
            elif declares_class(plain(head)):
                unnamed = self.read_class(plain(head), token)
                head = [Token("{}", token.line)]
            elif head and head[0].text in ("namespace", "inline", "extern") and not is_function(plain(head)):
                self.read_scope(token.inside, None, "public")
                head = []
            elif begins_body(plain(head)):
                self.read_function(head, token, owner, access)
                head = []
            else:
                head.append(token)

    def read_class(self, head, body):
        name = name_of_class(head)
        found = Class(self.file, head[0].line, name or "without a name")
        self.classes.append(found)
        self.read_scope(body.inside, found, "private" if "class" in words_of(head)[:2] else "public")
        return None if name else found

    def read_function(self, head, body, owner, access):
        declaration = plain(head)
        self.functions.append(Function(self.file, head[0].line, name_of_function(declaration),
                                       body.inside[-1].line - head[0].line + 1))
        if owner and access == "public" and "friend" not in words_of(declaration):
            owner.public_methods += 1
        self.read_local_classes(body.inside)

    def read_local_classes(self, tokens):
        """Reads the classes within a function's body."""
        head = []
        for token in tokens:
            if token.text == "{}" and declares_class(plain(head)):
                self.read_class(plain(head), token)
            else:
                self.read_local_classes(token.inside)
            head = [] if token.text in (";", "{}") else head + [token]

    def add_members(self, head, owner, access, unnamed):
        """Counts what a declaration that ends with a semicolon adds to `owner`."""
        words = words_of(head)
        if not owner or not words or words[0] == "}":
            return
        if words[0] == "{}":  # what follows a class
            if len(words) > 1:
                owner.fields += declarators(head)
            elif unnamed:
                owner.fields += unnamed.fields
                owner.public_methods += unnamed.public_methods
                self.classes.remove(unnamed)
        elif is_function(head) and words[0] not in ("using", "typedef", "friend", "static_assert"):
            if access == "public" and words[-2:] != ["=", "delete"]:
                owner.public_methods += 1
        elif words[0] not in NO_MEMBER and "static" not in words:
            owner.fields += declarators(head)


def cplusplus_files(root):
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in (".h", ".cc"):
                yield path.relative_to(root).as_posix()


def problems_of_file(file, text):
    """What is too large in one file."""
    lines = text.splitlines()
    if file.endswith(".h") and len(lines) > HEADER_LINES:
        yield f"{file}:{len(lines)}: header has {len(lines)} lines (limit {HEADER_LINES})"
    for number, line in enumerate(lines, 1):
        if len(line) > COLUMNS:
            yield f"{file}:{number}: line has {len(line)} columns (limit {COLUMNS})"
    if not file.endswith((".h", ".cc")):
        return
    found = Reader(file, text)
    for item in found.classes:
        if item.fields > FIELDS:
            yield f"{file}:{item.line}: class {item.name} has {item.fields} fields (limit {FIELDS})"
        if item.public_methods > PUBLIC_METHODS:
            yield f"{file}:{item.line}: class {item.name} has {item.public_methods} public methods (limit {PUBLIC_METHODS})"
    for item in found.functions:
        if item.lines > FUNCTION_LINES:
            yield f"{file}:{item.line}: function {item.name} has {item.lines} lines (limit {FUNCTION_LINES})"


def check(root):
    """All that is too large, one line each."""
    found = []
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in CODE or path.name == "CMakeLists.txt":
                found += problems_of_file(path.relative_to(root).as_posix(), path.read_text())
    return found


def largest(root, count):
    """A table of the largest classes, by fields and then by public methods."""
    classes = [item for file in cplusplus_files(root) for item in Reader(file, (root / file).read_text()).classes]
    for key in ("fields", "public_methods"):
        yield f"{key.replace('_', ' '):>14}  class"
        for item in sorted(classes, key=lambda item: -getattr(item, key))[:count]:
            yield f"{getattr(item, key):>14}  {item.name} ({item.file}:{item.line})"


def main():
    root = pathlib.Path(sys.argv[1])
    if sys.argv[2:3] == ["--largest"]:
        print("\n".join(largest(root, int(sys.argv[3]))))
        return 0
    found = check(root)
    for problem in found:
        print(problem)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
