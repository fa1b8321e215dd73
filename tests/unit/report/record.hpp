// SPDX-License-Identifier: GPL-3.0-or-later
// An item made by hand, without any stage: a ring with lugs whose upper lug edges were fitted, burred, planned and checked.
#pragma once

#include "planner/artefacts/report.hpp"

namespace asbuilt::test {

/// Everything an emitted item holds; the same bytes every time.
ItemRecord ring_record();
/// The same item, refused by the fit.
ItemRecord refused_record();

}  // namespace asbuilt::test
