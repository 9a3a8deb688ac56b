#pragma once

#include <pybind11/pybind11.h>

namespace hedgehop::python {

/// What native_bus.cpp adds to the module: Bus, LogReader, check of messages.
void add_bus(pybind11::module_& module);

}  // namespace hedgehop::python
