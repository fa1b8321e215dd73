// SPDX-License-Identifier: GPL-3.0-or-later
// One entry out of a ZIP archive (3MF files are such archives).
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace asbuilt {

/// The first bytes (at most `limit`) of the first entry whose name ends as asked; nothing where there is none or it is broken.
std::optional<std::string> read_zip_entry(std::string_view bytes, std::string_view name_end, std::size_t limit);

}  // namespace asbuilt
