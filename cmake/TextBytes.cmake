# weft_text_bytes(TEXT BYTES_VARIABLE LENGTH_VARIABLE): a text as the list of an array's elements in
# C++, "0x23,0x6c,", and how many they are.
function(weft_text_bytes text bytes_variable length_variable)
  string(HEX "${text}" digits)
  string(LENGTH "${digits}" length)
  math(EXPR length "${length} / 2")
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," bytes "${digits}")
  set(${bytes_variable} "${bytes}" PARENT_SCOPE)
  set(${length_variable} ${length} PARENT_SCOPE)
endfunction()
