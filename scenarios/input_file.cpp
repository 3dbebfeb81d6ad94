#include "scenarios/input_file.h"

#include <fmt/core.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include <fstream>
#include <iterator>

namespace lanewise {

std::string ReadText(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::string HashFile(const std::filesystem::path& file) {
  const std::string content = ReadText(file);
  return fmt::format("xxh3:{:016x}", XXH3_64bits(content.data(), content.size()));
}

}  // namespace lanewise
