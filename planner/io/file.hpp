// SPDX-License-Identifier: GPL-3.0-or-later
// Whole files as bytes, in and out.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "planner/base/result.hpp"

namespace asbuilt {

/// All bytes of a regular file. `name` is what a refusal calls it.
/// Refuses input.file_missing, input.file_unreadable (no permission, a folder, above 16 GiB).
Result<std::string> read_file(const std::filesystem::path& file, const std::string& name);

struct WrittenFile {
  std::size_t bytes_count = 0;
};
/// Writes aside and renames, so that no half file is ever seen. Creates the folder. Refuses input.file_unwritable.
Result<WrittenFile> write_file(const std::filesystem::path& file, std::string_view bytes);

/// Offset of the first byte that is not text: invalid UTF-8, or a control character other than tab and line end.
std::optional<std::size_t> first_not_utf8(std::string_view text);

}  // namespace asbuilt
