#!/bin/sh
# stage_python.sh PYTHON FOLDER: the interpreter's standard library and the packages that drives.py imports, for
# machines where nothing else is: run with PYTHONHOME=FOLDER PYTHONPATH=FOLDER/packages. Does nothing if FOLDER is
# complete.
set -eu
python=$1
folder=$2
imports="can can.interfaces.socketcan cantools cantools.database.can.formats.dbc moteus"
version=$("$python" -c 'import sys; print("python%d.%d" % sys.version_info[:2])')
complete="$version $imports $("$python" -m pip freeze | cksum)"
[ -e "$folder/complete" ] && [ "$(cat "$folder/complete")" = "$complete" ] && exit 0
rm -rf "$folder"
lib=$folder/lib/$version
mkdir -p "$lib" "$folder/packages"
stdlib=$("$python" -c 'import sysconfig; print(sysconfig.get_path("stdlib"))')
(cd "$stdlib" && tar cf - --exclude=__pycache__ --exclude='./test' --exclude='./idlelib' --exclude='./tkinter' \
  --exclude='./ensurepip' --exclude='./lib2to3' --exclude='./pydoc_data' --exclude='./config-*' --exclude='./turtledemo' \
  --exclude='./distutils' --exclude='./dist-packages' --exclude='./site-packages' .) | tar xf - -C "$lib"
# whatever these imports load from site-packages, as whole packages
# shellcheck disable=SC2086 # words on purpose
"$python" - "$folder/packages" $imports <<'END'
import importlib, os, shutil, sys
out, *names = sys.argv[1:]
for name in names:
    importlib.import_module(name)
for name in {module.split(".")[0] for module in sys.modules}:
    origin = getattr(sys.modules.get(name), "__file__", None) or ""
    if "site-packages" not in origin:
        continue
    if os.path.basename(origin) == "__init__.py":
        shutil.copytree(os.path.dirname(origin), os.path.join(out, name), ignore=shutil.ignore_patterns("__pycache__"))
    else:
        shutil.copy(origin, out)
END
# compiled here, whatever the files' times become: the emulated machine would take half a minute
# shellcheck disable=SC2086
PYTHONHOME=$folder PYTHONPATH=$folder/packages "$(readlink -f "$python")" - "$folder" $imports <<'END'
import importlib, py_compile, sys
folder, *names = sys.argv[1:]
for name in names:
    importlib.import_module(name)
for module in list(sys.modules.values()):
    source = getattr(module, "__file__", None) or ""
    if source.startswith(folder) and source.endswith(".py"):
        py_compile.compile(source, invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH)
END
echo "$complete" >"$folder/complete"
