// SPDX-License-Identifier: GPL-3.0-or-later
// The report page of one item: one file, no network. What a person has to read stands in the HTML itself; the scripts add the
// 3D view and the curves.
#pragma once

#include <string>
#include <string_view>

#include "planner/artefacts/report.hpp"

namespace asbuilt {

std::string report_page(const ItemRecord& record);

/// Text for HTML, outside and inside attributes.
std::string escaped(std::string_view text);
/// Text for a <script> of JSON: "</" cannot end the element.
std::string escaped_script(std::string text);
/// A number for reading: as many decimals as asked, "-" when it is not finite or was never measured (1e8 and above).
std::string shown(double value, int decimals);
/// For values of unknown size: four significant digits.
std::string shown_short(double value);

// Sections, in the page's order; empty where there is nothing to say.
std::string reasons_section(const ItemRecord& record);
std::string tiles_section(const ItemRecord& record);
std::string view_section(const ItemRecord& record);
std::string edges_section(const ItemRecord& record);
std::string checks_section(const ItemRecord& record);
std::string locate_section(const ItemRecord& record);
std::string programs_section(const ItemRecord& record);
std::string notes_section(const ItemRecord& record);
std::string inputs_section(const ItemRecord& record);
std::string timing_section(const ItemRecord& record);

}  // namespace asbuilt
