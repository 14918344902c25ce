;;; soter-mode.el --- Soter in Emacs -*- lexical-binding: t -*-
;; Emacs 29 has Eglot; before, it is the package `eglot'.  (load ".../soter-mode.el") in your init.
;; `soter-command' is where `soter' is, if it is not on the path.

(require 'eglot)

(defvar soter-command "soter" "The program `soter', by name or path.")

(define-derived-mode soter-mode prog-mode "Soter"
  "Programs of Soter."
  (setq-local comment-start "// " comment-end "" indent-tabs-mode nil tab-width 2)
  (modify-syntax-entry ?/ ". 124b")
  (modify-syntax-entry ?* ". 23")
  (modify-syntax-entry ?\n "> b")
  (modify-syntax-entry ?_ "w"))

(add-to-list 'auto-mode-alist '("\\.soter\\'" . soter-mode))
(add-to-list 'eglot-server-programs
             (cons 'soter-mode (lambda (&rest _) (list soter-command "lsp"))))
(add-hook 'soter-mode-hook #'eglot-ensure)

(provide 'soter-mode)
;;; soter-mode.el ends here
