--[[
darktable script: the target storage "straightened by unshutter" of the export module, by the command `unshutter`.

Each exported picture is straightened and put next to its original, under a new name: neither the original nor any other
file is replaced. The result is added to the collection, grouped with the original. A photo that unshutter leaves
unchanged gives no file; a message says why.
]]

local dt = require "darktable"

local COMMAND = os.getenv("UNSHUTTER") or "unshutter" -- its place, where that is not on the PATH
local WINDOWS = dt.configuration.running_os == "windows"
local SEPARATOR = WINDOWS and "\\" or "/"

-- A word of a command, so that the shell takes it as it is.
local function quoted(word)
  if WINDOWS then return '"' .. word:gsub('"', "") .. '"' end
  return "'" .. word:gsub("'", "'\\''") .. "'"
end

local function exists(path)
  local file = io.open(path, "rb")
  if file then file:close() end
  return file ~= nil
end

local function say(line)
  dt.print(line)
  dt.print_log("unshutter: " .. line)
end

-- A name next to the original that no file has: street.rectified.jpg, street.rectified-2.jpg.
local function free_name(image, exported)
  local stem = image.filename:gsub("%.[^.]*$", "")
  local ending = exported:match("%.[^.]*$") or ""
  local number = 1
  local name
  repeat
    name = image.path .. SEPARATOR .. stem .. ".rectified" .. (number > 1 and "-" .. number or "") .. ending
    number = number + 1
  until not exists(name)
  return name
end

-- Runs the command; returns whether it succeeded, and the first line that it printed.
local function run_command(photo, result)
  local words = { COMMAND, "rectify", photo, "-o", result }
  for k, word in ipairs(words) do words[k] = quoted(word) end
  local line = table.concat(words, " ") .. " 2>&1"
  local pipe = io.popen(WINDOWS and '"' .. line .. '"' or line)
  local printed = pipe:read("a")
  local succeeded = pipe:close()
  return succeeded, printed:match("[^\r\n]+") or (COMMAND .. " printed nothing")
end

-- Straightens what was exported of an image; returns the new file, or nil.
local function straighten(image, exported)
  local result = free_name(image, exported)
  local succeeded, line = run_command(exported, result)
  os.remove(exported)
  if not succeeded then
    say(image.filename .. ": " .. line)
    return nil
  end
  if line:find("left unchanged", 1, true) then
    os.remove(result) -- a copy of what was exported
    say(image.filename .. " is" .. line:match(" left unchanged.*"))
    return nil
  end
  say(image.filename .. ": " .. result)
  return result
end

local function store(_, image, _, exported, number, total)
  say(string.format("unshutter: %d of %d", number, total))
  local result = straighten(image, exported)
  if result then dt.database.import(result):group_with(image) end
end

dt.register_storage("unshutter", "straightened by unshutter", store)

return store -- for its test
