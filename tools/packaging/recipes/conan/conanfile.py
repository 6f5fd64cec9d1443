"""The core library: `conan create . --version VERSION`. Options choose what is built, as tiller's own CMake options do."""

import os

from conan import ConanFile
from conan.errors import ConanInvalidConfiguration
from conan.tools.build import check_min_cppstd
from conan.tools.cmake import CMake, CMakeDeps, CMakeToolchain, cmake_layout
from conan.tools.files import copy, get

LISTS = ("models", "planners", "posteriors", "limits")


class TillerConan(ConanFile):
    name = "tiller"
    description = "Model predictive control with an online posterior, in fixed memory"
    license = "BSD-3-Clause"
    topics = ("robotics", "model-predictive-control", "bayesian-inference", "embedded")
    package_type = "static-library"
    settings = "os", "arch", "compiler", "build_type"
    options = {"with_shared": [True, False], "reproducible": [True, False], "isa": ["ANY"],
               **{name: ["ANY"] for name in LISTS}}
    # An empty list is everything; "all" instruction sets run on every processor of the architecture.
    default_options = {"with_shared": False, "reproducible": False, "isa": "all", **{name: "" for name in LISTS}}

    def validate(self):
        if self.settings.os not in ("Linux", "baremetal"):
            raise ConanInvalidConfiguration("tiller is built and tested for Linux and for processors without a system")
        check_min_cppstd(self, 17)

    def layout(self):
        cmake_layout(self, src_folder="src")

    def requirements(self):
        if not self.options.reproducible:  # kernels and models of one's own include its headers
            self.requires("xsimd/[>=8.1]", transitive_headers=True)

    def source(self):
        get(self, **self.conan_data["sources"][self.version], strip_root=True)

    def generate(self):
        toolchain = CMakeToolchain(self)
        variables = toolchain.cache_variables
        for part in ("IO", "SIM", "TOOLS", "TESTS", "BENCHMARKS"):
            variables[f"TILLER_BUILD_{part}"] = False
        variables["TILLER_WITH_OSQP"] = False
        variables["TILLER_SHARED"] = bool(self.options.with_shared)
        variables["TILLER_REPRODUCIBLE"] = bool(self.options.reproducible)
        variables["TILLER_ISA_ONLY"] = "" if self.options.reproducible else str(self.options.isa)
        for name in LISTS:  # commas, since a semicolon ends a word in a shell
            variables[f"TILLER_{name.upper()}"] = str(getattr(self.options, name)).replace(",", ";")
        toolchain.generate()
        CMakeDeps(self).generate()

    def build(self):
        cmake = CMake(self)
        cmake.configure()
        cmake.build()

    def package(self):
        copy(self, "LICENSE", self.source_folder, os.path.join(self.package_folder, "licenses"))
        CMake(self).install()

    def package_info(self):
        # tiller's own package file is the one that knows the order of its archives
        self.cpp_info.set_property("cmake_find_mode", "none")
        self.cpp_info.builddirs = [os.path.join("lib", "cmake", "tiller")]
        self.cpp_info.includedirs = ["include", os.path.join("include", "tiller", "runtime")]
