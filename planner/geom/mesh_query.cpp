// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/geom/mesh_query.hpp"
