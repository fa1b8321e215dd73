// SPDX-License-Identifier: GPL-3.0-or-later
// What the reader is timed beside: a Part 21 reader as one writes it in an afternoon, and CGAL's own mesh refinement of the same faces.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "planner/io/step/sample.hpp"

namespace asbuilt::bench {

/// Entities as a map from id to keyword and parameters as strings, numbers and lists of them. Gives the number of parameters.
std::size_t plain_part21(std::string_view bytes);

/// Every face of the body flattened as the reader does it, then refined by CGAL::Delaunay_mesher_2 to the same steps; gives the number of
/// triangles. Borders are split face by face, so the result is not watertight: it is only timed.
std::size_t refined_by_cgal(step::Body& body, const step::Tolerance& tolerance);

}  // namespace asbuilt::bench
