// SPDX-License-Identifier: GPL-3.0-or-later
// The definitions of compiled_once.hpp.
#define ASBUILT_COMPILED_ONCE template
#include "planner/base/compiled_once.hpp"
