"""What can be said of the Python package without building it: sources, stubs, remedies and pyproject agree."""
import ast
import pathlib
import re
import sys
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "python/tiller"


def names_in(text, pattern):
    return set(re.findall(pattern, text, re.MULTILINE))


class Sources(unittest.TestCase):
    def test_every_file_parses(self):
        files = [*PACKAGE.glob("*.py*"), *(ROOT / "examples/python").glob("*.py")]
        self.assertGreater(len(files), 15)
        for file in files:
            if file.suffix in (".py", ".pyi"):
                ast.parse(file.read_text(encoding="utf-8"), str(file), feature_version=(3, 11))

    def test_statuses_have_remedies_and_stubs(self):
        table = dict((name, int(code)) for code, name in re.findall(
            r"^TILLER_STATUS\( *(\d+), (\w+),", (ROOT / "runtime/include/tiller/status.def").read_text(), re.MULTILINE))
        remedies = names_in((PACKAGE / "_errors.py").read_text(), r'^    "(\w+)": "')
        stubs = dict((name, int(code)) for name, code in re.findall(
            r"^    (\w+) = (\d+)$", (PACKAGE / "_core.pyi").read_text().split("class State")[0], re.MULTILINE))
        self.assertEqual(remedies, set(table))
        self.assertEqual(stubs, table)

    def test_stubs_name_what_the_bindings_bind(self):
        bound = set()
        for file in (ROOT / "python/bindings").glob("*.cpp"):
            text = file.read_text(encoding="utf-8")
            bound |= names_in(text, r'\.def(?:_prop_ro|_static)?\(\s*"([a-z]\w*)"') | names_in(
                text, r"^ +TILLER_SCALAR\((\w+),") | names_in(text, r'm\.def\(\s*"(\w+)"')
        told = names_in((PACKAGE / "_core.pyi").read_text(), r"^ *def ([a-z]\w*)\(")
        self.assertEqual(bound, told)

    def test_public_names_are_imported(self):
        tree = ast.parse((PACKAGE / "__init__.py").read_text(encoding="utf-8"))
        imported = {alias.asname or alias.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)
                    for alias in node.names}
        public = next(ast.literal_eval(node.value) for node in tree.body if isinstance(node, ast.Assign)
                      and isinstance(node.targets[0], ast.Name) and node.targets[0].id == "__all__")
        self.assertEqual(sorted(public), public)
        self.assertLessEqual(set(public), imported)

    @unittest.skipIf(sys.version_info < (3, 11), "no tomllib")
    def test_numpy_is_the_one_dependency(self):
        import tomllib
        project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
        self.assertEqual([re.split("[<>=]", d)[0] for d in project["dependencies"]], ["numpy"])
        version = re.search(r"project\(tiller VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text()).group(1)
        self.assertEqual(project["version"], version)
        self.assertIn(f'__version__ = "{version}"', (PACKAGE / "__init__.py").read_text())


if __name__ == "__main__":
    unittest.main()
