// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace asbuilt {

Result<std::string> read_file(const std::filesystem::path& file, const std::string& name) {
  const auto refused = [&](const char* code, const std::string& message) {
    return refuse({.code = code, .where = name, .message = message, .stage = "input"});
  };
  const int fd = ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) {
    const int error = errno;
    if (error == ENOENT || error == ENOTDIR)
      return refused("input.file_missing", "found no such file; check the path, which is relative to the file that names it");
    return refused("input.file_unreadable",
                   std::string("found a file that cannot be opened (") + std::strerror(error) + "); check its permissions");
  }
  struct stat info {};
  std::string bytes;
  const char* problem = nullptr;
  if (::fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) {
    problem = "found something that is no regular file, allowed a file";
  } else if (info.st_size > (16ll << 30)) {
    problem = "found more than 16 GiB, allowed less";
  } else {
    bytes.resize(std::size_t(info.st_size));
    std::size_t done = 0;
    while (done < bytes.size()) {
      const ssize_t n = ::read(fd, bytes.data() + done, bytes.size() - done);
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) break;
      done += std::size_t(n);
    }
    if (done != bytes.size()) problem = "found a file that ends while it is read; is it still being written?";
  }
  ::close(fd);
  if (problem) return refused("input.file_unreadable", problem);
  return bytes;
}

Result<WrittenFile> write_file(const std::filesystem::path& file, std::string_view bytes) {
  const auto refused = [&](const std::string& why) {
    return refuse(
        {.code = "input.file_unwritable", .where = file.string(), .message = "cannot write this file (" + why + ")", .stage = "input"});
  };
  std::error_code error;
  if (file.has_parent_path()) std::filesystem::create_directories(file.parent_path(), error);
  if (error) return refused(error.message());
  const std::filesystem::path aside = file.string() + ".part";
  const int fd = ::open(aside.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (fd < 0) return refused(std::strerror(errno));
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t n = ::write(fd, bytes.data() + done, bytes.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      const std::string why = std::strerror(errno);
      ::close(fd);
      ::unlink(aside.c_str());
      return refused(why);
    }
    done += std::size_t(n);
  }
  if (::close(fd) != 0) return refused(std::strerror(errno));
  std::filesystem::rename(aside, file, error);
  if (error) return refused(error.message());
  return WrittenFile{bytes.size()};
}

std::optional<std::size_t> first_not_utf8(std::string_view text) {
  std::size_t i = 0;
  while (i < text.size()) {
    const auto c = static_cast<unsigned char>(text[i]);
    if (c < 0x80) {
      if ((c < 0x20 && c != '\t' && c != '\n' && c != '\r') || c == 0x7f) return i;
      ++i;
      continue;
    }
    const int extra = c >= 0xf0 && c < 0xf5 ? 3 : c >= 0xe0 ? 2 : c >= 0xc2 ? 1 : 0;
    if (extra == 0 || c >= 0xf5 || i + std::size_t(extra) >= text.size()) return i;
    unsigned long code = c & (0x3f >> extra);
    for (int k = 1; k <= extra; ++k) {
      const auto d = static_cast<unsigned char>(text[i + std::size_t(k)]);
      if ((d & 0xc0) != 0x80) return i;
      code = (code << 6) | (d & 0x3f);
    }
    if ((extra == 2 && (code < 0x800 || (code >= 0xd800 && code < 0xe000))) || (extra == 3 && (code < 0x10000 || code > 0x10ffff)))
      return i;
    i += std::size_t(extra) + 1;
  }
  return std::nullopt;
}

}  // namespace asbuilt
