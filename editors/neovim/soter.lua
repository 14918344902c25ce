-- Soter in Neovim, 0.7 or newer: `luafile` this from your init.lua, or paste it there.
-- `vim.g.soter_command`, set before, is where `soter` is, if it is not on the path.
local command = vim.g.soter_command or "soter"

vim.api.nvim_create_autocmd({ "BufRead", "BufNewFile" }, {
  pattern = "*.soter",
  callback = function()
    vim.bo.commentstring = "// %s"
    vim.bo.filetype = "soter"
  end,
})

-- what a lens runs: in a terminal below
vim.lsp.commands["soter.terminal"] = function(lens)
  local it = lens.arguments[1]
  vim.cmd("silent! wall | botright new")
  vim.fn.termopen(vim.list_extend({ command }, vim.list_slice(it.command, 2)), { cwd = it.cwd })
end

if vim.lsp.config then
  vim.lsp.config("soter", {
    cmd = { command, "lsp" }, filetypes = { "soter" }, root_markers = { ".git" },
  })
  vim.lsp.enable("soter")
else
  local client
  vim.api.nvim_create_autocmd("FileType", {
    pattern = "soter",
    callback = function()
      client = client or vim.lsp.start_client({
        cmd = { command, "lsp" }, name = "soter", root_dir = vim.fn.getcwd(),
      })
      vim.lsp.buf_attach_client(0, client)
    end,
  })
end
