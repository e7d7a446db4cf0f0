"""The check of sizes counts what is planted in small sources, and finds nothing in the project as it is."""

import pathlib
import tempfile
import unittest

import sizes


def only_class(text):
    (found,) = sizes.Reader("a.h", text).classes
    return found


def fields(members):
    return only_class("struct S {\n" + members + "\n};").fields


def public_methods(members):
    return only_class("class C {\n public:\n" + members + "\n private:\n void Hidden();\n};").public_methods


class FieldsTest(unittest.TestCase):
    def test_each_declarator_is_a_field(self):
        self.assertEqual(fields("int a; int b = 0, c = f(1, 2), d{3};"), 4)
        self.assertEqual(fields("int a[3], b[2] = {1, 2}; unsigned c : 3, d : 5; const char* e;"), 5)

    def test_commas_and_brackets_of_templates_separate_nothing(self):
        self.assertEqual(fields("std::map<int, std::pair<int, int>> a; std::function<void(int, int)> b = nullptr;"), 2)
        self.assertEqual(fields("Grid<int> a{1, 2}; std::array<std::array<float, 3>, (2 > 1)> b = {};"), 2)

    def test_attributes_and_initializers_make_no_function_of_a_field(self):
        self.assertEqual(fields("int a ABSL_GUARDED_BY(mutex_) = 0; alignas(64) int b; [[maybe_unused]] int c{f()};"), 3)
        self.assertEqual(fields("std::function<int()> a = [] { int x; return x; }; void (*b)(int);"), 2)

    def test_what_is_no_member_of_an_object(self):
        self.assertEqual(fields("static constexpr int kA = 1; using B = int; enum class E { kA, kB }; friend class C; class D;"),
                         0)
        self.assertEqual(fields("static_assert(sizeof(int) == 4); typedef int T; template <class T> void F(T a, T b);"), 0)
        self.assertEqual(fields("S() : a_{1}, b_(2) { int c; } int F() const { return 1; } S& operator=(const S&) = default;"),
                         0)

    def test_comments_strings_and_preprocessor_lines_are_no_code(self):
        self.assertEqual(fields('// int a; }\n/* int b; { */ std::string c = "; int d; {"; char e = \';\';'), 2)
        self.assertEqual(fields('#define X int \\\n f; }\nstd::string a = R"x(int b; ")" })x"; int c = 1\'000;'), 2)

    def test_a_class_within_is_counted_by_itself(self):
        outer, inner = sizes.Reader("a.h", "struct A { int a; struct B { int c, d; } b; int e; };").classes
        self.assertEqual((outer.name, outer.fields, inner.name, inner.fields), ("A", 3, "B", 2))

    def test_the_members_of_an_unnamed_union_are_those_of_its_class(self):
        self.assertEqual(fields("union { int a; float b; }; int c;"), 3)

    def test_a_class_in_a_function_is_found(self):
        text = "template <class T> int F() {\n  if (x) { struct Local { int a, b; }; }\n  return 0;\n}"
        self.assertEqual((only_class(text).name, only_class(text).line, only_class(text).fields), ("Local", 2, 2))

    def test_names(self):
        for text in ("class Name { };", "template <class T, int N> struct Name final : public Base<T> { };",
                     'namespace a { class ABSL_LOCKABLE("x") alignas(8) Name : B, C { }; }', "static const struct Name { } x;"):
            self.assertEqual(only_class(text).name, "Name")


class PublicMethodsTest(unittest.TestCase):
    def test_overloads_constructors_and_operators(self):
        self.assertEqual(public_methods("C(); explicit C(int a) : a_{a} { } int F() const { return 1; } static int F(int);"), 4)
        self.assertEqual(public_methods("bool operator()(int) const; C& operator=(C&&) noexcept; virtual ~C() = 0;"), 3)

    def test_what_is_none(self):
        self.assertEqual(public_methods("C(const C&) = delete; using F = void(int); friend void G(C& c) { }"), 0)

    def test_templates_trailing_types_and_attributes(self):
        self.assertEqual(public_methods("template <class T> auto F(T t) -> std::vector<T> { return {t}; }"
                                        "void G() ABSL_LOCKS_EXCLUDED(mutex_); [[nodiscard]] int H() noexcept(true);"), 3)


class FunctionsTest(unittest.TestCase):
    def test_lines_and_names(self):
        text = "namespace a {\nint F(int x,\n      int y) {\n  return x + y;\n}\nA::B<int>::~B() : C<int>{1} { }\n}\n"
        found = [(item.name, item.line, item.lines) for item in sizes.Reader("a.cc", text).functions]
        self.assertEqual(found, [("F", 2, 4), ("A::B::~B", 6, 1)])

    def test_initializers_are_no_functions(self):
        self.assertEqual(sizes.Reader("a.cc", "const A a{1};\nB b = F(1, {2});\nint c[] = {\n1,\n2};").functions, [])


class FilesTest(unittest.TestCase):
    def problems(self, file, text):
        with tempfile.TemporaryDirectory() as root:
            path = pathlib.Path(root, file)
            path.parent.mkdir(parents=True)
            path.write_text(text)
            return sizes.check(pathlib.Path(root))

    def test_what_is_at_its_limit(self):
        members = "".join(f"  int a{i};\n" for i in range(15)) + "".join(f"  void F{i}();\n" for i in range(25))
        self.assertEqual(self.problems("server/a.h", "struct S {\n" + members + "};\n" + "\n" * 258), [])
        self.assertEqual(self.problems("server/a.cc", "int F() {\n" + "\n" * 58 + "}\n" + "x" * 110), [])

    def test_what_is_above(self):
        members = "".join(f"  int a{i};\n" for i in range(16)) + "".join(f"  void F{i}();\n" for i in range(26))
        self.assertEqual(self.problems("server/a.h", "struct S {\n" + members + "};\n" + "\n" * 257),
                         ["server/a.h:301: header has 301 lines (limit 300)", "server/a.h:1: class S has 16 fields (limit 15)",
                          "server/a.h:1: class S has 26 public methods (limit 25)"])
        self.assertEqual(self.problems("server/a.cc", "int F() {\n" + "\n" * 59 + "}\n"),
                         ["server/a.cc:1: function F has 61 lines (limit 60)"])
        for file in ("client/CMakeLists.txt", "server/page/a.js", "server/a.cmake", "worker/a.sh", "filter/a.py"):
            self.assertEqual(self.problems(file, "\n" + "x" * 111), [f"{file}:2: line has 111 columns (limit 110)"])


class ProjectTest(unittest.TestCase):
    def test_nothing_of_this_project_is_too_large(self):
        root = pathlib.Path(__file__).resolve().parents[2]
        self.assertGreater(len(list(sizes.cplusplus_files(root))), 500)
        self.assertEqual("\n".join(sizes.check(root)), "")


if __name__ == "__main__":
    unittest.main()
