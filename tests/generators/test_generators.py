"""Types that generators make of ``schemas/`` read every golden sample, in six languages.

The generators are installed once, into a cache outside the tree. If this machine lacks one, its
name is printed and it is skipped. Those that compile for minutes are nightly.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest
from installations import CACHE, installed, needs, npm_packages, run

from make.schema_files.samples import MESSAGES
from yahboomd.tools.schemas.event_kinds import EVENTS

SCHEMAS = Path(__file__).resolve().parents[2] / "schemas"
GOLDEN = SCHEMAS / "samples" / "json"
FILES = {**{name: name for name in MESSAGES}, **{name: f"events/{name}" for name in EVENTS}}
"""Every message, and the path of its schema below ``schemas/``, without its ending."""
SAMPLES = [GOLDEN / f"{path}.json" for path in FILES.values()]

NODE_PACKAGES = ("json-schema-to-typescript@15.0.4", "quicktype@26.0.0", "typescript@5.9.3")
PYTHON_PACKAGES = ("datamodel-code-generator==0.89.0", "msgspec")
JACKSON, KOTLIN = "2.18.2", "2.1.0"

# One process installs what several tests use.
pytestmark = [
    pytest.mark.realtime,
    pytest.mark.timeout(1800),
    pytest.mark.xdist_group("generators"),
]


@pytest.fixture(scope="session")
def node() -> Path:
    return npm_packages("node", NODE_PACKAGES) / "node_modules" / ".bin"


def flat(folder: Path) -> Path:
    """All schemas in one folder, as a generator takes them in one run."""
    made = folder / "schemas"
    made.mkdir()
    for path in FILES.values():
        shutil.copy(SCHEMAS / f"{path}.json", made)
    return made


def quicktype(node: Path, language: str, output: Path, *options: str) -> None:
    sources = [SCHEMAS / f"{path}.json" for path in FILES.values()]
    run(node / "quicktype", "-s", "schema", *sources, "-l", language, "-o", output, *options)


def without_nulls(value: object) -> object:
    """The value without nulls, which some languages leave out."""
    if isinstance(value, dict):
        return {key: without_nulls(each) for key, each in value.items() if each is not None}
    return value


def assert_the_same(output: str) -> None:
    """Each line of the output is a message's name and its golden sample, read and written again."""
    back = dict(line.split("\t", 1) for line in output.splitlines())
    assert back.keys() == FILES.keys()
    for name, text in back.items():
        sample = json.loads((GOLDEN / f"{FILES[name]}.json").read_text())
        assert without_nulls(json.loads(text)) == without_nulls(sample), name


def test_typescript_of_json_schema_to_typescript(node: Path, tmp_path: Path) -> None:
    run(node / "json2ts", "-i", flat(tmp_path), "-o", tmp_path / "made")
    lines = [
        f'import {{ {name} }} from "./made/{name}";\n'
        f"export const a{name}: {name} = {(GOLDEN / f'{path}.json').read_text()};"
        for name, path in FILES.items()
    ]
    (tmp_path / "main.ts").write_text("\n".join(lines))
    run(node / "tsc", "--noEmit", "--strict", "--target", "es2022", "main.ts", cwd=tmp_path)
    assert "never[]" not in "".join(path.read_text() for path in tmp_path.glob("made/*.ts"))


def test_python_of_datamodel_code_generator(tmp_path: Path) -> None:
    words = " ".join(PYTHON_PACKAGES)
    if (folder := installed("python", words)) is None:
        folder = CACHE / "python"
        run(sys.executable, "-m", "venv", folder)
        pip = (folder / "bin" / "python", "-m", "pip", "install", "-q")
        try:
            run(*pip, "--disable-pip-version-check", *PYTHON_PACKAGES)
        except AssertionError as error:
            pytest.skip(f"pip could not install the generator: {error}")
        (folder / ".installed").write_text(words)
    python = folder / "bin" / "python"
    run(
        *(folder / "bin" / "datamodel-codegen", "--input", flat(tmp_path)),
        *("--output", tmp_path / "made", "--input-file-type", "jsonschema"),
        *("--output-model-type", "msgspec.Struct"),
    )
    program = ["import msgspec", "from pathlib import Path"]
    for name, path in FILES.items():
        program += [
            f"import made.{name}",
            f"text = Path({str(GOLDEN / f'{path}.json')!r}).read_bytes()",
            f"value = msgspec.json.decode(text, type=made.{name}.{name})",
            f"print({name!r}, msgspec.json.encode(value).decode(), sep='\\t')",
        ]
    (tmp_path / "main.py").write_text("\n".join(program))
    assert_the_same(run(python, tmp_path / "main.py"))


@pytest.mark.nightly
def test_go_of_quicktype(node: Path, tmp_path: Path) -> None:
    go = needs("go")
    quicktype(node, "go", tmp_path / "types.go", "--package", "main")
    cases = "".join(
        f'\tcase "{name}":\n\t\tvar value {name}\n'
        "\t\tif err = json.Unmarshal(data, &value); err == nil {\n"
        "\t\t\tout, err = json.Marshal(value)\n\t\t}\n"
        for name in FILES
    )
    (tmp_path / "main.go").write_text(
        "package main\n\n"
        'import (\n\t"encoding/json"\n\t"fmt"\n\t"os"\n\t"path/filepath"\n\t"strings"\n)\n\n'
        "func main() {\n\tfor _, path := range os.Args[1:] {\n"
        "\t\tdata, err := os.ReadFile(path)\n\t\tif err != nil {\n\t\t\tpanic(err)\n\t\t}\n"
        '\t\tname := strings.TrimSuffix(filepath.Base(path), ".json")\n'
        "\t\tvar out []byte\n\t\tswitch name {\n"
        f"{cases}"
        "\t\t}\n\t\tif err != nil {\n\t\t\tpanic(err)\n\t\t}\n"
        '\t\tfmt.Printf("%s\\t%s\\n", name, out)\n\t}\n}\n'
    )
    (tmp_path / "go.mod").write_text("module check\n\ngo 1.21\n")
    assert_the_same(run(go, "run", ".", *SAMPLES, cwd=tmp_path))


@pytest.mark.nightly
def test_cpp_of_quicktype(node: Path, tmp_path: Path) -> None:
    compiler = needs("g++")
    if not Path("/usr/include/nlohmann/json.hpp").exists():
        pytest.skip("there is no nlohmann/json.hpp here (Debian: nlohmann-json3-dev)")
    quicktype(node, "c++", tmp_path / "types.hpp", "--namespace", "made", "--no-boost")
    cases = "".join(
        f'    if (name == "{name}") out = json(data.get<made::{name}>());\n' for name in FILES
    )
    (tmp_path / "main.cpp").write_text(
        "#include <filesystem>\n#include <fstream>\n#include <iostream>\n"
        '#include "types.hpp"\nusing nlohmann::json;\n'
        "int main(int count, char** paths) {\n  for (int i = 1; i < count; ++i) {\n"
        "    auto name = std::filesystem::path(paths[i]).stem().string();\n"
        "    json out, data = json::parse(std::ifstream(paths[i]));\n"
        f"{cases}"
        "    std::cout << name << '\\t' << out.dump() << '\\n';\n  }\n}\n"
    )
    run(compiler, "-std=c++17", "-I/usr/include/nlohmann", "-o", "check", "main.cpp", cwd=tmp_path)
    assert_the_same(run(tmp_path / "check", *SAMPLES))


@pytest.mark.nightly
def test_rust_of_typify(tmp_path: Path) -> None:
    cargo = needs("cargo")
    modules = "".join(
        f'mod m{name.lower()} {{ typify::import_types!("{SCHEMAS / path}.json"); }}\n'
        for name, path in FILES.items()
    )
    cases = "".join(
        f'            "{name}" => serde_json::to_string(\n'
        f"                &serde_json::from_str::<m{name.lower()}::{name}>(&text).unwrap()\n"
        "            ).unwrap(),\n"
        for name in FILES
    )
    project = CACHE / "rust"
    (project / "src").mkdir(parents=True, exist_ok=True)
    (project / "Cargo.toml").write_text(
        '[package]\nname = "check"\nversion = "0.0.0"\nedition = "2021"\n\n[dependencies]\n'
        'serde = { version = "1", features = ["derive"] }\nserde_json = "1"\ntypify = "0.8"\n'
    )
    (project / "src" / "main.rs").write_text(
        f"#![allow(dead_code)]\n{modules}\n"
        "fn main() {\n    for path in std::env::args().skip(1) {\n"
        "        let name = std::path::Path::new(&path).file_stem().unwrap().to_str().unwrap();\n"
        "        let text = std::fs::read_to_string(&path).unwrap();\n"
        "        let out = match name {\n"
        f"{cases}"
        "            _ => unreachable!(),\n        };\n"
        '        println!("{name}\\t{out}");\n    }\n}\n'
    )
    assert_the_same(run(cargo, "run", "--quiet", "--", *SAMPLES, cwd=project))


@pytest.mark.nightly
def test_kotlin_of_quicktype(node: Path, tmp_path: Path) -> None:
    maven, java = needs("mvn"), needs("java")
    words = f"{JACKSON} {KOTLIN}"
    if (folder := installed("kotlin", words)) is None:
        folder = CACHE / "kotlin"
        dependencies = "".join(
            f"<dependency><groupId>{group}</groupId><artifactId>{artifact}</artifactId>"
            f"<version>{version}</version></dependency>"
            for group, artifact, version in (
                ("org.jetbrains.kotlin", "kotlin-compiler-embeddable", KOTLIN),
                ("org.jetbrains.kotlin", "kotlin-reflect", KOTLIN),
                ("com.fasterxml.jackson.module", "jackson-module-kotlin", JACKSON),
            )
        )
        (folder / "pom.xml").write_text(
            '<project xmlns="http://maven.apache.org/POM/4.0.0"><modelVersion>4.0.0</modelVersion>'
            "<groupId>check</groupId><artifactId>check</artifactId><version>1</version>"
            f"<dependencies>{dependencies}</dependencies></project>"
        )
        try:
            run(maven, "-q", "dependency:copy-dependencies", "-DoutputDirectory=jars", cwd=folder)
        except AssertionError as error:
            pytest.skip(f"Maven could not fetch the compiler: {error}")
        (folder / ".installed").write_text(words)
    quicktype(node, "kotlin", tmp_path / "Types.kt", "--package", "made")
    cases = "".join(f'"{name}" -> {name}.fromJson(text).toJson()\n' for name in FILES)
    (tmp_path / "Main.kt").write_text(
        "package made\nimport java.io.File\nfun main(paths: Array<String>) {\n"
        "for (path in paths) {\nval text = File(path).readText()\n"
        f"val name = File(path).nameWithoutExtension\nval out = when (name) {{\n{cases}"
        'else -> error(name)\n}\nprintln("$name\\t$out")\n}\n}\n'
    )
    jars = ":".join(map(str, sorted((folder / "jars").glob("*.jar"))))
    run(
        *(java, "-cp", jars, "org.jetbrains.kotlin.cli.jvm.K2JVMCompiler", "-no-stdlib"),
        *("-no-reflect", "-cp", jars, "-d", tmp_path / "classes"),
        *(tmp_path / "Types.kt", tmp_path / "Main.kt"),
    )
    classes = f"{tmp_path / 'classes'}:{jars}"
    assert_the_same(run(java, "-cp", classes, "made.MainKt", *SAMPLES))
