"""The Zephyr module in a stand-in for Zephyr, which is not a package that can be installed:

    zephyr_test.py ROOT WORK

Kconfiglib, which Zephyr's Kconfig is made of, reads zephyr/Kconfig below a file with the symbols of Zephyr that it
names; CMake builds the image of zephyr_stand_in with the module; the emulated board runs it.
"""

import pathlib
import shutil
import subprocess
import sys

ZEPHYR = """mainmenu "stand-in"
config CPP
	bool
	default y
config FPU
	bool
	default y
source "{kconfig}"
"""


def configuration(root, work, module):
    import kconfiglib
    top = work / "Kconfig"
    top.write_text(ZEPHYR.format(kconfig=root / module["build"]["kconfig"]), encoding="utf-8")
    read = kconfiglib.Kconfig(str(top), warn_to_stderr=False)
    read.syms["TILLER"].set_value("y")
    read.syms["TILLER_C_MODELS"].set_value("n")
    if read.warnings:
        sys.exit("\n".join(read.warnings))
    read.write_config(str(work / ".config"))


def main(root, work):
    try:
        import kconfiglib  # noqa: F401
        import yaml
    except ImportError as missing:
        print(f"{missing}: pip install -r tools/dev/requirements_recipes.txt")
        return 77
    if not shutil.which("arm-none-eabi-g++") or not shutil.which("qemu-system-arm"):
        print("no arm-none-eabi-g++ or qemu-system-arm: ./dev cross small installs them")
        return 77
    root, work = pathlib.Path(root).resolve(), pathlib.Path(work).resolve()
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    module = yaml.safe_load((root / "zephyr/module.yml").read_text(encoding="utf-8"))
    configuration(root, work, module)
    here = pathlib.Path(__file__).resolve().parent / "zephyr_stand_in"
    subprocess.run(["cmake", "-S", here, "-B", work / "build", "-G", "Ninja", f"-DROOT={root}",
                    f"-DMODULE={root / module['build']['cmake']}", f"-DCONFIG={work / '.config'}",
                    f"-DCMAKE_TOOLCHAIN_FILE={root / 'cmake/toolchains/cortex_m7.cmake'}",
                    "-DCMAKE_BUILD_TYPE=Release"], check=True)
    subprocess.run(["cmake", "--build", work / "build", "--target", "image"], check=True)
    board = ["qemu-system-arm", "-M", "mps2-an500", "-nographic", "-monitor", "none", "-serial", "none", "-icount",
             "shift=7", "-semihosting-config", "enable=on,target=native,arg=tiller,arg=300", "-kernel"]
    done = subprocess.run([*board, work / "build/image"], capture_output=True, text=True, check=True)
    loops = [line for line in (done.stdout + done.stderr).splitlines() if " hash " in line]
    print("\n".join(loops))
    return 0 if len(loops) == 3 else 1  # mppi, ilqr, policy


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:3]))
