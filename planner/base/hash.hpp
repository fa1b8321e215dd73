// SPDX-License-Identifier: GPL-3.0-or-later
// SHA-256: the name of every input, artefact and program.
#pragma once

#include <string>
#include <string_view>

namespace asbuilt {

/// Lower-case hex SHA-256 of the bytes.
std::string sha256_hex(std::string_view bytes);

}  // namespace asbuilt
