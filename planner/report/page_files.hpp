// SPDX-License-Identifier: GPL-3.0-or-later
// The style and scripts of the report page (planner/report/page), built into the program.
#pragma once

namespace asbuilt {

extern const char* const page_style_css;
extern const char* const page_viewer_js;
extern const char* const page_charts_js;
extern const char* const page_page_js;

}  // namespace asbuilt
