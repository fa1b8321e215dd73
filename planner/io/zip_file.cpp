// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/zip_file.hpp"

#include <zlib.h>

#include <algorithm>
#include <cstdint>
#include <cstring>

namespace asbuilt {

namespace {

template <class T>
bool number_at(std::string_view bytes, std::size_t at, T& v) {
  if (at > bytes.size() || bytes.size() - at < sizeof v) return false;
  std::memcpy(&v, bytes.data() + at, sizeof v);
  return true;
}

}  // namespace

std::optional<std::string> read_zip_entry(std::string_view bytes, std::string_view name_end, std::size_t limit) {
  const std::size_t end = bytes.rfind(std::string_view("PK\5\6", 4));
  std::uint16_t entries = 0;
  std::uint32_t at = 0;
  if (end == std::string_view::npos || !number_at(bytes, end + 10, entries) || !number_at(bytes, end + 16, at)) return std::nullopt;
  std::size_t central = at;
  for (int i = 0; i < entries; ++i) {
    std::uint16_t method = 0, name_size = 0, extra_size = 0, comment_size = 0, local_name = 0, local_extra = 0;
    std::uint32_t packed = 0, plain = 0, local = 0, mark = 0;
    if (!number_at(bytes, central, mark) || mark != 0x02014b50u || !number_at(bytes, central + 10, method) ||
        !number_at(bytes, central + 20, packed) || !number_at(bytes, central + 24, plain) || !number_at(bytes, central + 28, name_size) ||
        !number_at(bytes, central + 30, extra_size) || !number_at(bytes, central + 32, comment_size) ||
        !number_at(bytes, central + 42, local) || bytes.size() - central < 46u + name_size)
      return std::nullopt;
    const std::string_view name = bytes.substr(central + 46, name_size);
    central += 46u + name_size + extra_size + comment_size;
    if (name.size() < name_end.size() || name.substr(name.size() - name_end.size()) != name_end) continue;
    if (!number_at(bytes, std::size_t(local) + 26, local_name) || !number_at(bytes, std::size_t(local) + 28, local_extra))
      return std::nullopt;
    const std::size_t begin = std::size_t(local) + 30u + local_name + local_extra;
    if (begin > bytes.size()) return std::nullopt;
    const std::string_view data = bytes.substr(begin, packed);
    if (method == 0) return std::string(data.substr(0, limit));
    if (method != 8) return std::nullopt;
    // Deflate cannot grow data more than about 1032 times, whatever the header says.
    std::string out(std::min({limit, std::size_t(plain), data.size() * 1040 + 64}), '\0');
    z_stream z{};
    if (inflateInit2(&z, -MAX_WBITS) != Z_OK) return std::nullopt;
    z.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(data.data()));
    z.avail_in = uInt(data.size());
    z.next_out = reinterpret_cast<Bytef*>(out.data());
    z.avail_out = uInt(out.size());
    const int status = inflate(&z, Z_SYNC_FLUSH);
    out.resize(z.total_out);
    inflateEnd(&z);
    if (status != Z_OK && status != Z_STREAM_END && status != Z_BUF_ERROR) return std::nullopt;
    return out;
  }
  return std::nullopt;
}

}  // namespace asbuilt
